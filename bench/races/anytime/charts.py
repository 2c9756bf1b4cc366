"""The interactive plot of an anytime race."""

from __future__ import annotations

import altair as alt
import numpy as np
import pandas as pd

from bench.report.charts import LEAST_GAP, lines, log
from bench.timing.schedule import PERIOD_US


def anytime(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """Gap within a budget of sampling periods."""
    table = table.assign(drawn=np.maximum(table.median_gap, LEAST_GAP))
    return lines(table, alt.X(**log("budget", f"sampling periods of {PERIOD_US:g} µs", table.budget)),
                 alt.Y(**log("drawn", "relative cost gap within them, median over the problems", table.drawn, power_of_ten=True)),
                 [alt.Tooltip("name:N"), alt.Tooltip("budget:Q"), alt.Tooltip("median_gap:Q", format=".1e"),
                  alt.Tooltip("worst_gap:Q", format=".1e")], "drawn", log_y=True, step=True)
