"""Plots as data: the columns of a table along the axes, and the marks.

Other modules declare plots here; `bench.report.vega` draws them. The rows of a plot or a mark are selected by values of
columns and not by an expression, because the texts of a run folder are not trusted. By convention a table has the
columns ``name``, the label of a line, ``view``, if the reader can choose between several views, and ``front``, whether
a line is among the best, which are drawn in colour and named.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pandas as pd

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
ROW = 20
"""Height of one bar in pixels."""


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
    label: str = ""
    """Label as an expression of Vega: a constant of this program."""
    domain: Sequence[float] = ()


@dataclass(frozen=True)
class Mark:
    """A mark for each row of the plot, or for those that ``where`` selects."""

    kind: Literal["line", "step", "point", "hollow", "bar", "range", "text"]
    """A text is the row's name below its point."""
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
    """Column that orders the points of a line, by default the horizontal one, or the parts of a bar."""
    x: str = ""
    """Column instead of the axis's own; ``x2`` and ``y2`` are the other end of a bar or range."""
    y: str = ""
    x2: str = ""
    y2: str = ""
    share: bool = False
    """Whether bars are stacked as shares of their sum."""


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
    legend: bool = True


def best_lines(kind: Literal["line", "step"] = "line", points: bool = False, along: str = "") -> tuple[Mark, ...]:
    """Many lines: the best in colour with names, the others grey, and those highlighted whose name the reader types."""
    dots = (
        (Mark("point", colour=GREY, size=12.0, opacity=0.35), Mark("point", "name", where={"front": [True]}, size=40.0))
        if points
        else ()
    )
    return (
        Mark(kind, colour=GREY, size=1.0, opacity=0.35, along=along),
        *dots[:1],
        Mark(kind, "name", where={"front": [True]}, along=along),
        *dots[1:],
        Mark(kind, sought=True, colour=INK, size=3.5, along=along),
    )


def first_view(table: pd.DataFrame) -> str:
    """The default view; "" for an empty table or one without views."""
    if "view" not in table:
        return ""
    names = dict.fromkeys(map(str, table["view"]))  # min takes the first of equals
    return min(names, key=lambda name: (not name.startswith("paper,"), "scaled" not in name), default="")


def together(parts: list[pd.DataFrame]) -> pd.DataFrame:
    """Concatenate tables; if all are empty, the first one gives the columns."""
    filled = [part for part in parts if len(part)]
    return pd.concat(filled, ignore_index=True) if filled else parts[0]


def log_ticks(values: pd.Series) -> tuple[list[float], str]:
    """Positions and number format of the labels of a logarithmic axis over these values; no positions if the axis is
    shorter than the ticks' spacing."""
    known = values[np.isfinite(values.astype(float)) & (values > 0.0)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (1.0, 10.0)
    first, last = int(np.floor(np.log10(low))), int(np.ceil(np.log10(high)))
    steps, every = ((1, 2, 5), 1) if last - first <= 3 else ((1,), 1 + (last - first) // 12)
    lines = [step * 10.0**k for k in range(first, last + 1, every) for step in steps]
    if sum(low <= line <= high for line in lines) < 2:
        return [], "~g"
    return lines, "~s" if last - first > 5 else "~g"
