"""Output of the command line: progress on standard error, tables and sentences on standard output."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from bench.messages import task
from bench.rendering import terminal

if TYPE_CHECKING:
    from bench.report.report import Report


COLUMNS, LINES = 100, 40
"""Size of the first screen."""


class PlainConsole(Console):
    """Shows text as it is: names and units such as [um] come from users' files and are neither markup nor control
    sequences."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)
        if not self.width:  # COLUMNS=0 in the environment, which means that it is unknown
            self.width = COLUMNS

    def render_str(self, text: str, **options: Any) -> Text:
        """Called for every printed string, including the cells of tables."""
        return super().render_str(terminal(text), **options)


console = PlainConsole(soft_wrap=True)
errors = PlainConsole(stderr=True)
AROUND, FEWEST_ROWS = 5, 10
"""Lines of the first screen around the table, and smallest number of rows of the table."""


@contextmanager
def progress_bar(what: str = "") -> Iterator[task.Progress]:
    """Show one step, and yield a function that shows (what, done, total); silent if standard error is not a
    terminal."""
    columns = (
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}", markup=False),
    )
    with Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bar:
        shown = bar.add_task(what, total=1 if what else None)
        yield lambda what, done, total: bar.update(shown, description=terminal(what), completed=done, total=total)


@contextmanager
def resumable(what: str, hint: str, refused: type[ValueError]) -> Iterator[None]:
    """Say how to continue work whose finished parts are kept, if it ends early."""
    try:
        yield
    except OSError as error:
        raise refused(f"{what}: {error.strerror or error}; {hint}") from None
    except KeyboardInterrupt:
        errors.print(f"Interrupted; {hint}.", soft_wrap=True)
        raise


def lines_of(texts: Iterable[str]) -> list[str]:
    """Sentences in lines of at most COLUMNS."""
    return [
        line
        for text in texts
        for line in textwrap.wrap(text, min(COLUMNS, console.width) if console.is_terminal else COLUMNS)
    ]


def print_table(
    headings: Sequence[str], rows: Sequence[Sequence[str]], left_aligned: int = 1, width: int = 240
) -> None:
    """Print a table, its first columns aligned to the left; outside a terminal, at most ``width`` wide."""
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 1, 0, 0) if width == COLUMNS else (0, 1))
    for i, heading in enumerate(headings):
        table.add_column(
            heading, justify="left" if i < left_aligned else "right", no_wrap=i < left_aligned, overflow="fold"
        )
    for row in rows:
        table.add_row(*row)
    (console if console.is_terminal else PlainConsole(width=width)).print(table)


def print_result(document: Any, as_json: bool, *parts: str | tuple[Any, ...]) -> None:
    """Print the result of a verb: a JSON document, where null is an unknown number, or sentences and tables (the
    arguments of :func:`print_table`) in this order, those that are empty left out."""
    if as_json:
        print(json.dumps(plain_json(document), indent=1, allow_nan=False))
        return
    for part in filter(None, parts):
        if isinstance(part, str):
            console.print(part)
        else:
            print_table(*part)


def print_report(report: Report, document: Any, as_json: bool, below: Sequence[str], files: Sequence[str]) -> None:
    """Print a JSON document, or the first screen of a report: the verdict, the rows of the short table that fit, the
    lines below, and lines that name its files."""
    lines, shown = lines_of(report.verdict), report.terminal or report.table
    parts: list[str | tuple[Any, ...]] = []
    if shown is not None and shown.rows:
        lines += ["", *lines_of([f"{shown.title}. {shown.note}" if shown.note else f"{shown.title}:"])]
        rows = shown.rows[: max(LINES - len(lines) - len(below) - AROUND, FEWEST_ROWS)]
        more = len((report.table or shown).rows) - len(rows)
        parts = [(shown.headings, rows, shown.left_aligned, COLUMNS), f"{more} more rows are on the page." * (more > 0)]
    print_result(document, as_json, "\n".join(lines), *parts, "\n".join([*below, *files]))


def plain_json(value: Any) -> Any:
    """A value converted to JSON's types: null for a number that is not finite, text for any other type.

    Examples
    --------
    >>> plain_json({"a": (1.0, float("nan")), "b": "x"})
    {'a': [1.0, None], 'b': 'x'}
    """
    return json.loads(
        json.dumps(value, default=lambda other: other.item() if isinstance(other, np.generic) else str(other)),
        parse_constant=lambda _: None,
    )
