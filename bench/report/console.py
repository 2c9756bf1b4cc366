"""What the command line shows: progress on standard error while it works, tables and sentences on standard output."""

from __future__ import annotations

import json
import os
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from bench.messages import progress
from bench.rendering import terminal

if TYPE_CHECKING:
    from bench.report.report import Report


class PlainConsole(Console):
    """Shows text as it is: names and units such as [um] come from files of users, and are neither markup nor
    commands."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Every string that is printed, in tables, too, comes by here."""
        return super().render_str(terminal(text), **options)


console = PlainConsole(soft_wrap=True)
errors = PlainConsole(stderr=True)
COLUMNS, LINES = 100, 40
"""Of the first screen."""
AROUND, FEWEST_ROWS = 5, 10
"""Lines of the first screen between table and sentences, and rows of the table that it has at least."""
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON on standard output in place of tables and sentences.")]


@contextmanager
def progress_bar() -> Iterator[progress.Progress]:
    """Yield a function that is told (what, done, total); silent when standard error is not a terminal."""
    columns = (
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}", markup=False),
    )
    with Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bar:
        shown = bar.add_task("", total=None)
        yield lambda what, done, total: bar.update(shown, description=terminal(what), completed=done, total=total)


def check_writable(out: Path, option: str = "--out") -> None:
    """Refuse a file that cannot be written before the work and not after it."""
    if not out.parent.is_dir():
        raise typer.BadParameter(f"the folder {out.parent} does not exist", param_hint=option)
    if out.exists() and not out.is_file():  # it would be replaced, be it /dev/null
        raise typer.BadParameter(f"{out} is {'a folder' if out.is_dir() else 'no ordinary file'}", param_hint=option)
    if not os.access(out.parent, os.W_OK):
        raise typer.BadParameter(f"nothing may be written into the folder {out.parent}", param_hint=option)


def lines_of(texts: Iterable[str]) -> list[str]:
    """Sentences in lines of at most COLUMNS."""
    return [
        line
        for text in texts
        for line in textwrap.wrap(text, min(COLUMNS, console.width) if console.is_terminal else COLUMNS)
    ]


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1, width: int = 240) -> None:
    """Print a table, the first ``left`` columns aligned to the left; where nobody looks, as wide as it needs up to
    ``width``."""
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 1, 0, 0) if width == COLUMNS else (0, 1))
    for i, heading in enumerate(headings):
        table.add_column(heading, justify="left" if i < left else "right", no_wrap=i < left, overflow="fold")
    for row in rows:
        table.add_row(*row)
    (console if console.is_terminal else PlainConsole(width=width)).print(table)


def print_report(report: Report, below: Sequence[str] = ()) -> None:
    """The first screen of a report: verdict, as many rows of the short table as there is room for, how many more there
    are, and lines below."""
    above, shown = lines_of(report.verdict), report.terminal or report.table
    if shown is not None and shown.rows:
        above += ["", *lines_of([f"{shown.title}. {shown.note}" if shown.note else f"{shown.title}:"])]
    for line in above:
        console.print(line)
    if shown is not None and shown.rows:
        rows = shown.rows[: max(LINES - len(above) - len(below) - AROUND, FEWEST_ROWS)]
        print_table(shown.headings, rows, left=shown.left, width=COLUMNS)
        if (more := len((report.table or shown).rows) - len(rows)) > 0:
            console.print(f"{more} more rows are on the page.")
    for line in below:
        console.print(line)


def print_json(value: Any) -> None:
    """Print a document for machines; null stands for what is not known."""
    print(json.dumps(plain_json(value), indent=1, allow_nan=False))


def plain_json(value: Any) -> Any:
    """A value as JSON can hold it: null stands for a number that is not finite, text for what is none of JSON's.

    Examples
    --------
    >>> plain_json({"a": (1.0, float("nan")), "b": "x"})
    {'a': [1.0, None], 'b': 'x'}
    """
    return json.loads(json.dumps(value, default=_plain), parse_constant=lambda _: None)


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else str(value)


def records(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[dict[str, str]]:
    """Rows of a table by their headings."""
    return [dict(zip(headings, row, strict=True)) for row in rows]
