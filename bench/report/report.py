"""Reports as data: sentences, tables, and figures with their plots, of a run, a comparison or a recording.

There are three renderings: the terminal (`bench.report.console`), Markdown and an HTML page (`bench.report.writing`);
`bench.report.vega` draws the plots. The rows of a plot or a mark are selected by values of columns and not by an
expression, because the texts of a run folder are not trusted. By convention the table of a figure has the columns
``name``, the label of a line, ``view``, if the reader can choose between several views, and ``front``, whether a line
is among the best, which are drawn in colour and named.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Self

import pandas as pd

from bench.messages.columns import Column
from bench.report.words import by_heading

LEAST_GAP = 1e-17
"""Smallest cost gap on a plot; smaller ones are drawn at this value."""
BEST = 12
"""Most lines of a plot in colour; twelve can be distinguished."""
PALETTE = ("#1f86c7", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Okabe and Ito's colours, which colour-blind readers can distinguish, with a lighter blue that is legible on a dark
page too."""
GREY = "#999999"
INK = "currentColor"
Where = Mapping[str, Sequence[object]]
"""The rows whose values in each of these columns are among those given; all rows if it is empty."""
HEIGHT = 380


@dataclass(frozen=True)
class Axis:
    """A column along an axis; a column of names has one position for each name."""

    column: str
    title: str = ""
    log: bool = False
    format: str = ""
    """Format of the labels by d3; by default as the values need."""
    values: Sequence[float] = ()
    """Positions of the labels."""
    domain: Sequence[float] = ()


@dataclass(frozen=True)
class Mark:
    """A mark for each row of the plot, or for those that ``where`` selects."""

    kind: Literal["line", "step", "point", "hollow", "bar", "range", "text"]
    """A text is the row's name, ``dx`` and ``dy`` pixels beside and below its point."""
    by: str = ""
    """Column whose values determine the colour."""
    where: Where = field(default_factory=dict)
    sought: bool = False
    """Whether it is for the rows whose name the reader types."""
    colour: str = ""
    size: float = 1.6
    """Width of a line in pixels, or area of a point in square pixels."""
    opacity: float = 1.0
    along: str = ""
    """Column that orders the points of a line, by default the horizontal one."""
    x: str = ""
    """Column instead of the horizontal axis's own; ``x2`` is the other end of a bar or range."""
    x2: str = ""


@dataclass(frozen=True)
class Plot:
    """One pair of axes."""

    x: Axis
    y: Axis
    marks: Sequence[Mark]
    tips: Sequence[str] = ()
    """Columns shown under the pointer."""
    colours: Mapping[str, str] = field(default_factory=dict)
    """Colour of each value of a mark's column ``by``; by default the palette in the order of the table."""
    rules: Mapping[str, float] = field(default_factory=dict)
    """Dashed lines at values of ``x`` or ``y``."""
    height: int = HEIGHT
    where: Where = field(default_factory=dict)
    """The rows of the table to draw."""


def best_lines(along: str) -> tuple[Mark, ...]:
    """Many lines with points, ordered by a column: the best in colour with names, the others grey, and those
    highlighted whose name the reader types."""
    best: Where = {"front": [True]}
    return (
        Mark("line", colour=GREY, size=1.0, opacity=0.35, along=along),
        Mark("point", colour=GREY, size=12.0, opacity=0.35),
        Mark("line", "name", where=best, along=along),
        Mark("point", "name", where=best, size=40.0),
        Mark("line", sought=True, colour=INK, size=3.5, along=along),
    )


def first_view(table: pd.DataFrame) -> str:
    """The default view; "" for an empty table or one without views."""
    names = dict.fromkeys(map(str, table.get("view", ())))  # min takes the first of equals
    return min(names, key=lambda name: (not name.startswith("paper,"), "scaled" not in name), default="")


@dataclass(frozen=True)
class Table:
    """A table of texts; the page sorts a column by the numbers at the start of its cells."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    left_aligned: int = 1
    """Number of columns aligned to the left."""
    filters: Sequence[str] = ("lane", "tier", "status")
    """Headings of the columns that can be filtered on the page."""
    note: str = ""
    """Text above the table."""
    file: str = ""
    """File with the same rows, which Markdown names instead of a long table."""
    tips: Mapping[tuple[int, int], str] = field(default_factory=dict)
    """Text under the pointer, by row and column."""

    @classmethod
    def of(cls, title: str, lines: pd.DataFrame, columns: Iterable[Column], left_aligned: int = 1, **more: Any) -> Self:
        """The columns that have a heading, in their format; ``more`` are other fields."""
        shown = [column for column in columns if column.heading]
        cells = [[column.format(line[column.name]) for column in shown] for line in lines.to_dict("records")]
        return cls(title, [column.heading for column in shown], cells, left_aligned, **more)

    @property
    def choices(self) -> dict[str, list[str]]:
        """The values of each filtered column that has several."""
        values = {
            name: sorted({row[list(self.headings).index(name)] for row in self.rows})
            for name in self.filters
            if name in self.headings
        }
        return {name: texts for name, texts in values.items() if len(texts) > 1}


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
    files: Mapping[str, Callable[[Path], None]] = field(default_factory=dict)
    """Further files beside the report by name, and what writes them."""
    failed: str = ""
    """A sentence with the lanes of a user's own files that fail, for which the command ends with status 1."""

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
            "failed": self.failed,
            "rows": [] if self.summary is None else self.summary.to_dict("records"),
            "tables": [{"title": table.title, "rows": by_heading(table.headings, table.rows)} for table in tables],
        }
