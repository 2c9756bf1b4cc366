"""What all figures of the experiment share: their colours, their plots of lines, and how they are written beside their numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import altair as alt
import numpy as np
import pandas as pd
import vl_convert
from numpy.typing import NDArray

from bench.report import svg
from bench.report.charts import COLOURS, data
from piezo_model.atomic_file import replacing, write_text

STRAIGHT, LEARNED, HINDSIGHT, OTHER = (COLOURS[lane] for lane in ("kernel", "direct", "qpsolvers", "cvxpy"))
REFERENCE = "#000000"
CONTINUOUS = "#56b4e9"
"""One colour for one thing in every figure, of Okabe and Ito's palette."""
PALE = "#d9d9d9"
PIXELS = 1.5
"""Of a PNG for each of the SVG."""
DASHED, DOTTED = (5, 4), (1, 3)


@dataclass(frozen=True)
class Exhibit:
    """A figure with its numbers and what they say."""

    name: str
    """Of its files, without ending."""
    title: str
    caption: str
    sentences: tuple[str, ...]
    """The verdict in words, with numbers."""
    table: pd.DataFrame
    """The numbers that are drawn."""
    chart: alt.TopLevelMixin

    def write(self, folder: Path) -> None:
        """Write ``<name>.png``, ``.svg`` and ``.csv``; each is there whole or not at all."""
        drawn = svg.text([self.chart])
        write_text(folder / f"{self.name}.svg", drawn)
        with replacing(folder / f"{self.name}.png") as temporary:
            temporary.write_bytes(vl_convert.svg_to_png(drawn, scale=PIXELS))
        with replacing(folder / f"{self.name}.csv") as temporary:
            self.table.to_csv(temporary, index=False, float_format="%.6g")


@dataclass(frozen=True)
class Line:
    """A line of a plot: its points in their order, and what it looks like; with a shape its points are marked."""

    name: str
    x: NDArray[Any]
    y: NDArray[Any]
    colour: str
    dash: tuple[int, ...] = ()
    shape: str = ""
    width: float = 1.2


def axis(title: str, **scale: Any) -> dict[str, Any]:
    """Title and scale of an axis; without ``domain`` that of its data, which need not hold 0."""
    return {"title": title, "scale": alt.Scale(**{"zero": False, "nice": False, **scale})}


def plot(lines: Sequence[Line], x: Mapping[str, Any], y: Mapping[str, Any], width: int, height: int, title: str = "",
         legend: bool = True) -> alt.LayerChart:
    """Lines over each other, the last on top, with a legend above; `axis` makes ``x`` and ``y``."""
    names = [line.name for line in lines]
    key = alt.Legend(columns=2, symbolType="stroke", symbolSize=200, labelLimit=300) if legend else None
    layers = []
    for line in lines:
        source = data(pd.DataFrame({"x": line.x, "y": line.y, "at": np.arange(len(line.x)), "line": line.name}))
        base = alt.Chart(source).encode(x=alt.X("x:Q", **x), y=alt.Y("y:Q", **y), color=alt.Color(
            "line:N", scale=alt.Scale(domain=names, range=[line.colour for line in lines]), legend=key))
        layers.append(base.mark_line(clip=True, strokeWidth=line.width, strokeDash=[*line.dash]).encode(order="at:Q"))
        if line.shape:
            layers.append(base.mark_point(filled=True, size=40, opacity=1.0, shape=line.shape))
    whole: Any = alt.layer(*layers)
    return whole.properties(width=width, height=height, title=title)


def beside(*plots: Any, **shared: Any) -> alt.HConcatChart:
    """Plots in a row, each with a legend of its own unless ``color="shared"``; ``y="shared"`` for one vertical scale."""
    return alt.hconcat(*plots).resolve_scale(**{"color": "independent", **shared})


def above(*plots: Any) -> alt.VConcatChart:
    """Plots under each other, each with a legend of its own."""
    return alt.vconcat(*plots).resolve_scale(color="independent")
