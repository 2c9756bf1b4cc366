"""What all figures of the experiment share: their colours, their look, and how they are written beside their numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.report.charts import COLOURS
from piezo_model.atomic_file import replacing

STRAIGHT, LEARNED, HINDSIGHT, OTHER = (COLOURS[lane] for lane in ("kernel", "direct", "qpsolvers", "cvxpy"))
REFERENCE = "#000000"
CONTINUOUS = "#56b4e9"
"""One colour for one thing in every figure, of Okabe and Ito's palette."""
PALE = "#d9d9d9"
WIDTH_IN = 9.0
LOOK: dict[Any, Any] = {"svg.hashsalt": "piezobench", "svg.fonttype": "none", "font.size": 9.0, "axes.titlesize": 10.0,
        "axes.titlelocation": "left", "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
        "grid.alpha": 0.3, "legend.fontsize": 8.0, "legend.frameon": False, "lines.linewidth": 1.2}
"""The same numbers draw the same SVG."""


@dataclass(frozen=True)
class Exhibit:
    """A figure with its numbers and what they say.

    Attributes
    ----------
    name : str
        Of its files, without ending.
    title, caption : str
    sentences : tuple of str
        The verdict in words, with numbers.
    table : DataFrame
        The numbers that are drawn.
    draw : function of a Figure
    height_in : float
    """

    name: str
    title: str
    caption: str
    sentences: tuple[str, ...]
    table: pd.DataFrame
    draw: Callable[[Figure], None]
    height_in: float = 4.5

    def write(self, folder: Path) -> None:
        """Write ``<name>.png``, ``.svg`` and ``.csv``; each is there whole or not at all."""
        with mpl.rc_context(LOOK):
            figure = Figure(figsize=(WIDTH_IN, self.height_in), layout="constrained")
            self.draw(figure)
            with replacing(folder / f"{self.name}.png") as temporary:
                figure.savefig(temporary, format="png", dpi=150, metadata={"Software": None})
            with replacing(folder / f"{self.name}.svg") as temporary:
                figure.savefig(temporary, format="svg", metadata={"Date": None})
        with replacing(folder / f"{self.name}.csv") as temporary:
            self.table.to_csv(temporary, index=False, float_format="%.6g")


def legend_above(axes: Axes, columns: int = 4) -> None:
    """A legend in one line between title and axes, where it hides nothing."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.2)
