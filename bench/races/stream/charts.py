"""The interactive plots of a stream race."""

from __future__ import annotations

import altair as alt
import pandas as pd

from bench.report.charts import lines, log
from bench.timing.schedule import PERIOD_US


def deadline_profile(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """Share of samples answered within k periods."""
    return lines(table, alt.X(**log("periods", f"k: periods of {PERIOD_US:g} µs after the due time", table.periods)),
                 alt.Y("share:Q", title="share of samples answered within k periods", axis=alt.Axis(format="%", tickCount=5),
                       scale=alt.Scale(domain=[0, 1])),
                 [alt.Tooltip("name:N"), alt.Tooltip("periods:Q"), alt.Tooltip("share:Q", format=".3%")], "share",
                 log_y=False, step=True)


def latency_tails(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """Response time against percentile, with the deadline."""
    tick = "'p' + format(100 * (1 - 1 / datum.value), '.6~f')"
    x = alt.X("one_in:Q", scale=alt.Scale(type="log", nice=False, padding=8), title="percentile of the samples",
              axis=alt.Axis(values=[2, 10, 100, 1_000, 10_000, 100_000, 1_000_000], labelExpr=tick))
    return lines(table, x, alt.Y(**log("us", "response time, µs (compiled loops: service time)", table.us)),
                 [alt.Tooltip("name:N"), alt.Tooltip("us:Q", format=".3~g", title="µs"), alt.Tooltip("one_in:Q", format=".3~s")],
                 "us", log_y=True, deadline=True)
