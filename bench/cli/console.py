"""What the command line shows: progress on standard error while it works, tables and sentences on standard output."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from bench.race import Progress as Report

console = Console(highlight=False, soft_wrap=True)
errors = Console(stderr=True, highlight=False)


@contextmanager
def progress_bar() -> Iterator[Report]:
    """Yield a function that is told (what, done, total); silent when standard error is not a terminal."""
    columns = (BarColumn(bar_width=24), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bar:
        shown = bar.add_task("", total=None)
        yield lambda what, done, total: bar.update(shown, description=what, completed=done, total=total)


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> None:
    """Print a table, the first ``left`` columns aligned to the left; as wide as it needs where nobody looks."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for i, heading in enumerate(headings):
        table.add_column(heading, justify="left" if i < left else "right", no_wrap=i < left, overflow="fold")
    for row in rows:
        table.add_row(*row)
    (console if console.is_terminal else Console(width=240, highlight=False)).print(table)
