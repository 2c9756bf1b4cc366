"""Plots of a run, as SVG; the figures come from `plot_data`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from bench.races.oneshot import plot_data
from bench.report.charts import COLOURS, LEAST_GAP
from bench.report.svg import finish, page
from bench.timing.schedule import PERIOD_US


def accuracy_against_time(rows: pd.DataFrame, path: Path) -> None:
    """The picture of the project: worst cost gap against time for one answer, with the sampling period as a line."""
    table = plot_data.accuracy(rows)
    table = table[table.scaling == "scaled"]
    table = table[table["view"] == table["view"].iloc[0]] if len(table) else table
    figure, axes = page()
    for lane, part in table[table.pace == plot_data.FULL_SOLVE].groupby("lane"):
        gap = np.maximum(part.worst_cost_gap, LEAST_GAP)
        axes.scatter(part.total_us, gap, s=28, color=COLOURS[str(lane)], label=f"{lane!s} lane", zorder=3)
        if lane in ("direct", "kernel"):
            for time, height, name in zip(part.total_us, gap, part.solver, strict=True):
                axes.annotate(name, (time, height), (3, 3), textcoords="offset points", fontsize=7)
    for solver, part in table[table.pace == plot_data.PAPERS_PACE].groupby("solver"):
        axes.plot(part.total_us, np.maximum(part.worst_cost_gap, LEAST_GAP), marker=".", lw=1,
                  label=f"{solver!s}, {plot_data.PAPERS_PACE}")
    axes.axvline(PERIOD_US, color="black", lw=1, ls="--")
    axes.annotate("sampling period, 125 µs", (PERIOD_US, 1.0), (4, -10), xycoords=("data", "axes fraction"),
                  textcoords="offset points", fontsize=8)
    axes.set(xscale="log", yscale="log", xlabel="time for one answer, µs (update and solve)",
             ylabel="worst relative cost gap to the certified optimum")
    if len(table):
        axes.set_title(table["view"].iloc[0], fontsize=9)
    finish(figure, axes, path, fontsize=8)


def time_against_size(table: pd.DataFrame, path: Path) -> None:
    """The lines of :func:`bench.races.oneshot.plot_data.time_by_size`, of one view, with the sampling period."""
    figure, axes = page(5.0)
    sizes = [column for column in table.columns if column not in ("view", "name")]
    for _, line in table[table["view"] == table["view"].iloc[0]].iterrows():
        ours = str(line["name"]).startswith(plot_data.OURS)
        axes.plot(sizes, line[sizes].to_numpy(dtype=float), marker=".", lw=2 if ours else 1, ls="-" if ours else "--",
                  label=line["name"])
    axes.axhline(PERIOD_US, color="black", lw=1, ls=":")
    axes.set(xscale="log", yscale="log", xlabel="unknowns d", ylabel="time for one answer, µs (update and solve)",
             title=table["view"].iloc[0])
    axes.set_xticks(sizes, [str(d) for d in sizes])
    axes.minorticks_off()
    finish(figure, axes, path, fontsize=8)
