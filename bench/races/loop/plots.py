"""The picture of the closed-loop race, as SVG."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bench.races.loop.race import DRIFTING, STILL
from bench.report.charts import LEAST_GAP
from bench.report.svg import HINDSIGHT, LEARNED, STRAIGHT, look, save


def closed_loop(table: pd.DataFrame, path: Path) -> None:
    """Cost gap, tracking error and staleness side by side, a line a solver, the most exact one on top."""
    order = table.groupby("who").cost_gap.max().sort_values(ascending=False, na_position="first").index
    with look():
        figure = Figure(figsize=(9.0, 1.3 + 0.2 * len(order)), layout="constrained")
        panels = figure.subplots(1, 3, sharey=True)
        for problem, colour, marker, size in ((STILL, LEARNED, "o", 5), (DRIFTING, STRAIGHT, "x", 5)):
            part = table[table.problem == problem].set_index("who").reindex(order)
            drawn = (np.maximum(part.cost_gap, LEAST_GAP), part.rms_percent, part.learn_samples)
            for axes, values in zip(panels, drawn, strict=True):
                axes.plot(values, np.arange(len(order)), color=colour, marker=marker, ms=size, ls="", label=f"{problem} stage")
            panels[1].axvline(part.rms_percent.min(), color=colour, lw=0.8, ls=":")
        names = ("relative cost gap in use", "RMS error, % of range", "staleness, samples")
        for axes, name in zip(panels, names, strict=True):
            axes.set(xscale="log", xlabel=name)
        panels[0].set_yticks(range(len(order)), order)
        panels[0].set_ylim(-1.0, len(order))
        if len(table):
            panels[1].axvline(float(table.straight_rms_percent.median()), color=HINDSIGHT, ls="--", label="straight line")
        figure.legend(*panels[1].get_legend_handles_labels(), loc="outside upper right", ncols=3)
        save(figure, path)
