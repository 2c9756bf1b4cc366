"""The picture of the anytime race, as SVG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bench.races.anytime import figures
from bench.races.anytime.race import BUDGETS
from bench.report.charts import LEAST_GAP
from bench.report.svg import finish, page

LANES, MARKS = {"kernel": "-", "direct": "--"}, {"kernel": "^", "direct": "v"}


def anytime(rows: pd.DataFrame, path: Path) -> None:
    """Median cost gap against sampling periods, for the first set, size and scaling of the run."""
    figure, axes = page()
    table = figures.wide(figures.summary(rows))
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
            ls = ":" if line.pace == figures.PAPER else LANES[str(line.lane)]
            drawn: dict[str, Any] = {"color": colour, "ls": ls, "marker": "."}
            single: dict[str, Any] = {} if line.solver in limited else {"marker": MARKS[str(line.lane)], "ls": "none",
                                                                        "markersize": 6}
            shown = there if line.solver in limited else there & (np.cumsum(there) == 1)
            pace = f", {line.pace}" if line.pace == figures.PAPER else ""
            axes.plot(np.array(BUDGETS)[shown], np.maximum(gaps[shown], LEAST_GAP), lw=1.0,
                      label=f"{line.solver} ({line.lane}{pace})", **{**drawn, **single})
        axes.set_title(f"{problem_set}, d = {d}, {scaling} data", fontsize=9)
    axes.set(xscale="log", yscale="log", xlabel="sampling periods of 125 µs",
             ylabel="relative cost gap within them, median over the problems")
    finish(figure, axes, path, columns=2)
