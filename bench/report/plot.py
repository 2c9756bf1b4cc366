"""Plots as data: which columns of a table lie along which axes, and with what marks.

A room that has something to show names columns here and draws nothing; `bench.report.vega` makes the drawing. By
convention a table has the columns ``name``, what a line stands for, ``view``, where there is a choice between several,
and ``front``, whether a line is among the best, which have colours and names.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pandas as pd

LEAST_GAP = 1e-17
"""Cost gaps below this are drawn at it."""
BEST = 12
"""Lines of a picture that have colours and names; there are twelve that can be told apart."""
PALETTE = ("#1f86c7", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Okabe and Ito's colours, which colour-blind readers can tell apart; their blue is too dark to be read on a dark page,
this one is read on both."""
GREY = "#999999"
INK = "currentColor"
HEIGHT = 380
ROW = 20
"""Height of one bar, pixels."""


@dataclass(frozen=True)
class Axis:
    """A column along an axis; one of names has an entry for each."""

    column: str
    title: str = ""
    log: bool = False
    powers_of_ten: bool = False
    """Whether its labels are."""
    percent: bool = False
    values: Sequence[float] = ()
    """Where it has labels."""
    label: str = ""
    """Vega's expression for a label."""
    domain: Sequence[float] = ()


@dataclass(frozen=True)
class Mark:
    """What stands at each row of the table, or at those for which Vega's expression ``where`` is true."""

    kind: Literal["line", "step", "point", "hollow", "bar", "range"]
    by: str = ""
    """Column whose values have colours of their own."""
    where: str = ""
    colour: str = ""
    size: float = 1.6
    """Width of a line in pixels, area of a point in square pixels."""
    opacity: float = 1.0
    along: str = ""
    """Column that orders the points of a line, if it is not the horizontal one, or the parts of a bar."""
    x: str = ""
    """Column in place of the one of the axis; likewise for the other end of a bar or range."""
    y: str = ""
    x2: str = ""
    y2: str = ""
    share: bool = False
    """Whether bars are stacked to shares of their sum."""


@dataclass(frozen=True)
class Plot:
    """One pair of axes."""

    x: Axis
    y: Axis
    marks: Sequence[Mark]
    tips: Sequence[str] = ()
    """Columns that are shown under the pointer."""
    colours: Mapping[str, str] = field(default_factory=dict)
    """Of the values of a mark's ``by``; without them the palette in the order of the table."""
    rules: Mapping[str, float] = field(default_factory=dict)
    """Dashed lines at values of ``x`` or ``y``."""
    height: int = HEIGHT
    where: str = ""
    """Rows of the table that are drawn, in pandas' words."""


def best_lines(kind: Literal["line", "step"] = "line", points: bool = False, along: str = "") -> tuple[Mark, ...]:
    """Lines of a crowd: the best in colours with names, the others grey, and whichever is sought for by its name on the
    page."""
    sought = "sought != '' && indexof(lower(datum.name), lower(sought)) >= 0"
    dots = (
        (Mark("point", colour=GREY, size=12.0, opacity=0.35), Mark("point", "name", where="datum.front", size=40.0))
        if points
        else ()
    )
    return (
        Mark(kind, colour=GREY, size=1.0, opacity=0.35, along=along),
        *dots[:1],
        Mark(kind, "name", where="datum.front", along=along),
        *dots[1:],
        Mark(kind, where=sought, colour=INK, size=3.5, along=along),
    )


def first_view(table: pd.DataFrame) -> str:
    """The view that is shown by default, "" of an empty table or one without views."""
    if "view" not in table:
        return ""
    names = dict.fromkeys(map(str, table["view"]))  # min takes the first of equals
    return min(names, key=lambda name: (not name.startswith("paper,"), "scaled" not in name), default="")


def together(parts: list[pd.DataFrame]) -> pd.DataFrame:
    """The parts under each other, the first of which may have the columns alone."""
    whole = [part for part in parts if len(part)]
    return pd.concat(whole, ignore_index=True) if whole else parts[0]


def log_ticks(values: pd.Series) -> tuple[list[float], str]:
    """Where a logarithmic axis over these values has lines, where a reader counts, and how their labels are written;
    none on a short stretch."""
    known = values[np.isfinite(values.astype(float)) & (values > 0.0)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (1.0, 10.0)
    first, last = int(np.floor(np.log10(low))), int(np.ceil(np.log10(high)))
    steps, every = ((1, 2, 5), 1) if last - first <= 3 else ((1,), 1 + (last - first) // 12)
    lines = [step * 10.0**k for k in range(first, last + 1, every) for step in steps]
    if sum(low <= line <= high for line in lines) < 2:
        return [], "~g"
    return lines, "~s" if last - first > 5 else "~g"
