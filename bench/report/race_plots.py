"""The pictures of the stream and the anytime race, as SVG; the figures come from their own modules."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.races.anytime import BUDGETS
from bench.report import anytime_figures
from bench.report.markdown import settings_label
from bench.report.plots import FLOOR as LEAST_GAP
from bench.timing import latency_histogram
from bench.timing.percentiles import needed
from bench.timing.schedule import PERIOD_NS
from piezo_model.atomic_file import replacing

SHOWN = 8
"""Paced solver lanes that are drawn."""
LANES, MARKS = {"kernel": "-", "direct": "--"}, {"kernel": "^", "direct": "v"}


def latency(table: pd.DataFrame, path: Path) -> None:
    """Response time against percentile, as far as the samples support it; compiled loops by their service time, dotted."""
    figure, axes = _page()
    paced = table[table.paced & ~table.is_floor & (table.samples > 0)]
    kernel = table[~table.paced & (table.samples > 0) & (table.solver != "projected_difference")]
    parts: tuple[tuple[pd.DataFrame, str, dict[str, Any]], ...] = (
        (table[table.is_floor & (table.samples > 0)], "response", {"color": "black", "ls": "--"}),
        (paced.head(SHOWN), "response", {}), (kernel, "service", {"ls": ":"}))
    for part, kind, style in parts:
        for i, (_, line) in enumerate(part.iterrows()):
            tail = _tail(int(line[f"{kind}_samples"]))
            if not tail.size:
                continue
            us = np.maximum(latency_histogram.quantiles(line[f"{kind}_histogram"], 1.0 - tail) / 1e3, 1e-3)
            settings = settings_label(str(line.settings))
            label = "the machine itself" if line.is_floor else f"{line.solver} ({line.lane}{settings and f', {settings}'})"
            axes.plot(1.0 / tail, us, label=label, lw=1.2, **{"color": f"C{i % 10}", **style})
    period = PERIOD_NS / 1e3
    axes.axhline(period, color="black", lw=0.8)
    axes.annotate(f"deadline, {period:g} µs", (1.0, period), (2, 3), xycoords=("axes fraction", "data"),
                  textcoords="offset points", fontsize=8, ha="right")
    axes.set(xscale="log", yscale="log", xlabel="percentile", ylabel="response time, µs (dotted: service time, not paced)")
    ticks = [2, 10, 100, 1_000, 10_000, 100_000, 1_000_000]
    axes.set_xticks(ticks, [f"p{100.0 * (1.0 - 1.0 / tick):.10g}" for tick in ticks])
    _save(figure, axes, path)


def _tail(samples: int) -> NDArray[np.float64]:
    """Shares above the percentiles that so many samples support, from one half down."""
    decades = np.geomspace(0.5, 1e-7, 200)
    return np.array([share for share in decades if needed(1.0 - share) <= samples])


def anytime(rows: pd.DataFrame, path: Path) -> None:
    """Median cost gap against sampling periods, for the first set, size and scaling of the run."""
    figure, axes = _page()
    table = anytime_figures.wide(anytime_figures.summary(rows))
    table = table[table.lane.isin(["kernel", "direct"])]
    first = next(iter(table.groupby(["problem_set", "d", "scaling"], sort=False)), None)
    if first is not None:
        (problem_set, d, scaling), part = first
        limited = set(rows[rows.iteration_setting != ""].solver)
        colours: dict[str, str] = {}
        for _, line in part.iterrows():
            gaps = np.array([float(line[budget]) for budget in BUDGETS])
            there = np.isfinite(gaps)
            if not there.any():
                continue
            colour = colours.setdefault(str(line.solver), f"C{len(colours) % 10}")  # one for a solver in all lanes
            ls = ":" if line.pace == anytime_figures.PAPER else LANES[str(line.lane)]
            drawn: dict[str, Any] = {"color": colour, "ls": ls, "marker": "."}
            single: dict[str, Any] = {} if line.solver in limited else {"marker": MARKS[str(line.lane)], "ls": "none",
                                                                        "markersize": 6}
            shown = there if line.solver in limited else there & (np.cumsum(there) == 1)
            pace = f", {line.pace}" if line.pace == anytime_figures.PAPER else ""
            axes.plot(np.array(BUDGETS)[shown], np.maximum(gaps[shown], LEAST_GAP), lw=1.0,
                      label=f"{line.solver} ({line.lane}{pace})", **{**drawn, **single})
        axes.set_title(f"{problem_set}, d = {d}, {scaling} data", fontsize=9)
    axes.set(xscale="log", yscale="log", xlabel="sampling periods of 125 µs",
             ylabel="relative cost gap within them, median over the problems")
    _save(figure, axes, path, columns=2)


def _page() -> tuple[Figure, Axes]:
    mpl.rcParams["svg.hashsalt"] = "piezobench"  # the same run draws the same file
    mpl.rcParams["svg.fonttype"] = "none"
    figure = Figure(figsize=(9, 5.5), layout="constrained")
    return figure, figure.add_subplot()


def _save(figure: Figure, axes: Axes, path: Path, columns: int = 1) -> None:
    axes.grid(alpha=0.3)
    count = len(axes.get_legend_handles_labels()[0])
    if count:
        axes.legend(fontsize=7, ncols=min(columns, math.ceil(count / 10)))
    with replacing(path) as temporary:
        figure.savefig(temporary, format="svg", metadata={"Date": None})
