"""Report of a run, a comparison, a fleet, a recording or the experiment: sentences, tables and figures as data.

There are three renderings: the terminal (`bench.report.console`), Markdown and an HTML page (`bench.report.writing`).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from pathlib import Path
from typing import Any, Self

import pandas as pd

from bench.messages.columns import Column
from bench.report.plot import Plot
from bench.report.words import by_heading, marked


@dataclass(frozen=True)
class Table:
    """A table of texts; the page sorts a column by the numbers at the start of its cells."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: int = 1
    """Number of columns aligned to the left."""
    filters: Sequence[str] = ("lane", "tier", "status")
    """Headings of the columns that can be filtered on the page."""
    note: str = ""
    """Text above the table."""
    file: str = ""
    """File with the same rows, which Markdown names instead of a long table."""

    @classmethod
    def of(cls, title: str, lines: pd.DataFrame, columns: Iterable[Column], left: int = 1, **more: Any) -> Self:
        """The columns that have a heading, in their format; ``more`` are other fields."""
        shown = [column for column in columns if column.heading]
        cells = [[column.format(line[column.name]) for column in shown] for line in lines.to_dict("records")]
        return cls(title, [column.heading for column in shown], cells, left, **more)

    @property
    def choices(self) -> dict[str, list[str]]:
        """The values of each filtered column that has several."""
        found = {
            name: sorted({row[list(self.headings).index(name)] for row in self.rows})
            for name in self.filters
            if name in self.headings
        }
        return {name: texts for name, texts in found.items() if len(texts) > 1}


def side_by_side(
    lines: pd.DataFrame, table: pd.DataFrame, by: str, columns: Iterable[Column]
) -> tuple[pd.DataFrame, list[Column]]:
    """The lines, each of one ``label`` and ``lane``, with these columns of a table once for each value of ``by``, which
    their headings name."""
    wide = []
    for value, part in table.groupby(by, sort=False):
        here = {column.name: replace(column, name=f"{column.name} {value}") for column in columns}
        wide += [replace(column, heading=column.heading.format(value)) for column in here.values()]
        shown = part[["label", "lane", *here]].rename(columns={name: column.name for name, column in here.items()})
        lines = lines.merge(shown, how="left", on=["label", "lane"])
    return lines, wide


def what_went_wrong(rows: pd.DataFrame, columns: Sequence[str], once: Sequence[str]) -> Table:
    """The given columns of the rows with a message, one row for each combination of values in the columns ``once``."""
    wrong = rows[rows.message != ""].drop_duplicates([*once])[[*columns]]
    return Table(
        "What went wrong",
        columns,
        wrong.assign(solver=wrong.solver.map(marked)).astype(str).values.tolist(),
        len(columns),
    )


@dataclass(frozen=True)
class Figure:
    """One or several plots of a table, one below the other."""

    name: str
    """File name of the data and of the picture."""
    title: str
    definition: str
    """Definition of the plotted quantities, in sentences."""
    data: pd.DataFrame
    """The table of the plots."""
    plots: Sequence[Plot]


@dataclass(frozen=True)
class Report:
    """Contents of a report; figures of empty tables are left out."""

    verdict: Sequence[str]
    """First sentences of every rendering."""
    table: Table | None = None
    """The short table of the first screen; its note defines the numbers."""
    summary: pd.DataFrame | None = None
    """The complete table, for ``summary.csv`` and JSON."""
    figures: Sequence[Figure] = ()
    """The first one stands beside the short table."""
    notes: Sequence[str] = ()
    """Further findings."""
    tables: Sequence[Table] = ()
    definitions: Sequence[str] = ()
    limits: Sequence[str] = ()
    """Limits of validity, and the state of the machine during the run."""
    environment: Sequence[tuple[str, str]] = ()
    """Machine, versions and settings as pairs of name and text."""
    terminal: Table | None = None
    """The short table for a terminal of 100 columns, if it differs."""
    title: str = ""
    scope: str = ""
    """Problems, machine and its drift, before the first figure."""
    files: Mapping[str, Callable[[Path], None]] = dataclass_field(default_factory=dict)
    """Further files beside the report by name, and what writes them."""

    @property
    def drawn(self) -> list[Figure]:
        """The figures with data."""
        return [figure for figure in self.figures if len(figure.data)]

    @property
    def document(self) -> dict[str, Any]:
        """The report as a JSON document."""
        tables = [self.table, *self.tables] if self.table is not None else self.tables
        return {
            "verdict": self.verdict,
            "notes": self.notes,
            "rows": [] if self.summary is None else self.summary.to_dict("records"),
            "tables": [{"title": table.title, "rows": by_heading(table.headings, table.rows)} for table in tables],
        }
