"""What a run says and shows, computed once and rendered in the terminal, as Markdown and as a page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import altair as alt
import pandas as pd

from bench.report import charts
from bench.report.words import marked

Draw = Callable[[pd.DataFrame], list[alt.TopLevelMixin]]


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
        found = {name: sorted({row[list(self.headings).index(name)] for row in self.rows}) for name in self.filters if name in self.headings}
        return {name: texts for name, texts in found.items() if len(texts) > 1}

    @property
    def records(self) -> list[dict[str, str]]:
        """Rows by their headings."""
        return [dict(zip(self.headings, row, strict=True)) for row in self.rows]


def what_went_wrong(rows: pd.DataFrame, columns: Sequence[str], once: Sequence[str]) -> Table:
    """These columns of the rows with a message, the first row of each that has the same in ``once``."""
    wrong = rows[rows.message != ""].drop_duplicates([*once])[[*columns]]
    return Table("What went wrong", columns, wrong.assign(solver=wrong.solver.map(marked)).astype(str).values.tolist(), len(columns))


@dataclass(frozen=True)
class Figure:
    """One plot or several of the same data."""

    name: str
    """Of the files of its data and, in Markdown, of its picture."""
    title: str
    definition: str
    """What is drawn and how it is defined, in sentences."""
    data: pd.DataFrame
    """Everything that is drawn."""
    plots: Sequence[alt.TopLevelMixin]

    @classmethod
    def of(cls, name: str, title: str, definition: str, data: pd.DataFrame, draw: Draw) -> Figure:
        """The figure that is drawn of a table; without plots where that is empty."""
        return cls(name, title, definition, data, draw(data) if len(data) else ())

    @property
    def specifications(self) -> list[dict[str, Any]]:
        """What the page's script draws."""
        return [charts.specification(plot) for plot in self.plots]


@dataclass(frozen=True)
class Report:
    """What a run says and shows."""

    verdict: Sequence[str]
    """At most three sentences, which open every rendering."""
    ranking: Table
    """The short table of the first screen; its note says what the figures mean."""
    summary: pd.DataFrame
    """Everything, as ``summary.csv`` and for machines."""
    figures: Sequence[Figure] = ()
    """The first is the picture of the first screen; those without plots are left out."""
    notes: Sequence[str] = ()
    """Further findings."""
    tables: Sequence[Table] = ()
    definitions: Sequence[str] = ()
    limits: Sequence[str] = ("One machine, one run: compare ratios, not microseconds.",)
    """What stands below."""
    terminal: Table | None = None
    """The short table where a line has 100 columns, if it differs."""
    drawn: Sequence[Figure] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "drawn", [figure for figure in self.figures if figure.plots])

    @property
    def document(self) -> dict[str, Any]:
        """Everything for machines."""
        return {"verdict": self.verdict, "notes": self.notes, "rows": self.summary.to_dict("records"),
                "tables": [{"title": table.title, "rows": table.records} for table in (self.ranking, *self.tables)]}
