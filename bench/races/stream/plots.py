"""The picture of the stream race, as SVG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.report.markdown import settings_label
from bench.report.svg import finish, page
from bench.timing import latency_histogram
from bench.timing.percentiles import needed
from bench.timing.schedule import PERIOD_US

SHOWN = 8
"""Paced solver lanes that are drawn."""


def latency(table: pd.DataFrame, path: Path) -> None:
    """Response time against percentile, as far as the samples support it; compiled loops by their service time, dotted."""
    figure, axes = page()
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
    axes.axhline(PERIOD_US, color="black", lw=0.8)
    axes.annotate(f"deadline, {PERIOD_US:g} µs", (1.0, PERIOD_US), (2, 3), xycoords=("axes fraction", "data"),
                  textcoords="offset points", fontsize=8, ha="right")
    axes.set(xscale="log", yscale="log", xlabel="percentile", ylabel="response time, µs (dotted: service time, not paced)")
    ticks = [2, 10, 100, 1_000, 10_000, 100_000, 1_000_000]
    axes.set_xticks(ticks, [f"p{100.0 * (1.0 - 1.0 / tick):.10g}" for tick in ticks])
    finish(figure, axes, path)


def _tail(samples: int) -> NDArray[np.float64]:
    """Shares above the percentiles that so many samples support, from one half down."""
    decades = np.geomspace(0.5, 1e-7, 200)
    return np.array([share for share in decades if needed(1.0 - share) <= samples])
