"""Plots as SVG beside a report in Markdown, with what they have in common."""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.report.charts import COLOURS
from piezo_model.atomic_file import replacing

STRAIGHT, LEARNED, HINDSIGHT = COLOURS["kernel"], COLOURS["direct"], COLOURS["qpsolvers"]
LOOK: dict[Any, Any] = {"svg.hashsalt": "piezobench", "svg.fonttype": "none", "font.size": 9.0, "axes.titlesize": 10.0,
        "axes.titlelocation": "left", "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
        "grid.alpha": 0.3, "legend.fontsize": 8.0, "legend.frameon": False, "lines.linewidth": 1.2}


def look() -> AbstractContextManager[None]:
    """The look, for as long as it lasts; the same numbers draw the same SVG."""
    return mpl.rc_context(LOOK)


def page(height_in: float = 5.5) -> tuple[Figure, Axes]:
    """An empty plot; the same run draws the same file."""
    mpl.rcParams["svg.hashsalt"] = "piezobench"
    mpl.rcParams["svg.fonttype"] = "none"
    figure = Figure(figsize=(9, height_in), layout="constrained")
    return figure, figure.add_subplot()


def save(figure: Figure, path: Path) -> None:
    """Write the file, whole or not at all."""
    with replacing(path) as temporary:
        figure.savefig(temporary, format="svg", metadata={"Date": None})


def finish(figure: Figure, axes: Axes, path: Path, columns: int = 1, fontsize: int = 7) -> None:
    """Add grid and legend and write the file."""
    axes.grid(alpha=0.3)
    if count := len(axes.get_legend_handles_labels()[0]):  # somebody answered
        axes.legend(fontsize=fontsize, ncols=min(columns, math.ceil(count / 10)))
    save(figure, path)
