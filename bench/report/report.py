"""What a run, a comparison, a fleet, a recording or the experiment says and shows: sentences, tables and figures as
data.

It is rendered once for each of three readers: the terminal (`bench.report.console`), Markdown and a page
(`bench.report.writing`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from bench.report.plot import Plot
from bench.report.words import by_heading, marked


@dataclass(frozen=True)
class Table:
    """A table with its cells as text; a page sorts its columns by the numbers that cells begin with."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: int = 1
    """Columns of names, aligned to the left."""
    filters: Sequence[str] = ("lane", "tier", "status")
    """Headings of the columns that a page offers a choice for."""
    note: str = ""
    """What stands above it."""

    @property
    def choices(self) -> dict[str, list[str]]:
        """The values to choose from by heading, where a column has several."""
        found = {
            name: sorted({row[list(self.headings).index(name)] for row in self.rows})
            for name in self.filters
            if name in self.headings
        }
        return {name: texts for name, texts in found.items() if len(texts) > 1}


def what_went_wrong(rows: pd.DataFrame, columns: Sequence[str], once: Sequence[str]) -> Table:
    """These columns of the rows with a message, the first row of each that has the same in ``once``."""
    wrong = rows[rows.message != ""].drop_duplicates([*once])[[*columns]]
    return Table(
        "What went wrong",
        columns,
        wrong.assign(solver=wrong.solver.map(marked)).astype(str).values.tolist(),
        len(columns),
    )


@dataclass(frozen=True)
class Figure:
    """One plot of a table or several under each other."""

    name: str
    """Of the files of its data and of its picture."""
    title: str
    definition: str
    """What is drawn and how it is defined, in sentences."""
    data: pd.DataFrame
    """Everything that is drawn."""
    plots: Sequence[Plot]


@dataclass(frozen=True)
class Report:
    """What is said and shown; figures of empty tables are left out."""

    verdict: Sequence[str]
    """What opens every rendering."""
    table: Table | None = None
    """The short table of the first screen; its note says what the figures mean."""
    summary: pd.DataFrame | None = None
    """Everything, as ``summary.csv`` and for machines."""
    figures: Sequence[Figure] = ()
    """The first is the picture of the first screen."""
    notes: Sequence[str] = ()
    """Further findings."""
    tables: Sequence[Table] = ()
    definitions: Sequence[str] = ()
    limits: Sequence[str] = ()
    """What the figures do not say, and what the machine was doing meanwhile."""
    environment: Sequence[tuple[str, str]] = ()
    """Machine, versions and settings as names and texts."""
    terminal: Table | None = None
    """The short table where a line has 100 columns, if it differs."""
    title: str = ""
    scope: str = ""
    """What was measured, where, and how steady the machine was; stands before the first figure."""

    @property
    def drawn(self) -> list[Figure]:
        """The figures that have something to show."""
        return [figure for figure in self.figures if len(figure.data)]

    @property
    def document(self) -> dict[str, Any]:
        """Everything for machines."""
        tables = [self.table, *self.tables] if self.table is not None else self.tables
        return {
            "verdict": self.verdict,
            "notes": self.notes,
            "rows": [] if self.summary is None else self.summary.to_dict("records"),
            "tables": [{"title": table.title, "rows": by_heading(table.headings, table.rows)} for table in tables],
        }
