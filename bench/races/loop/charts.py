"""The interactive plots of a closed-loop race."""

from __future__ import annotations

from typing import Any

import altair as alt
import numpy as np
import pandas as pd

from bench.report.charts import LEAST_GAP, PALETTE, data, finished, log, named, names_beside


def by_gap(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """Tracking error by stage against cost gap."""
    table = table.assign(drawn=np.maximum(table.cost_gap, LEAST_GAP))
    return [_against("drawn", log("drawn", "cost gap of the weights in use", table.drawn, power_of_ten=True), table)]


def by_time(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """Tracking error by stage against the time to learn."""
    return [_against("learn_samples", log("learn_samples", "time to learn, samples", table.learn_samples), table)]


def _against(column: str, x: dict[str, Any], table: pd.DataFrame) -> alt.TopLevelMixin:
    """Tracking error against a column on a logarithmic axis."""
    table = table.assign(view="")
    table = table.assign(named=named(table, column, "rms_percent", "name", wide=480))
    source = data(table)
    base = alt.Chart(source).encode(x=alt.X(**x), y=alt.Y(**log("rms_percent", "RMS error, % of range", table.rms_percent)))
    stage = alt.Color("problem:N", scale=alt.Scale(range=PALETTE[:2]))
    points = base.mark_point(filled=True, size=70, opacity=0.9).encode(
        color=stage, shape="problem:N", tooltip=[
            alt.Tooltip("name:N"), alt.Tooltip("problem:N", title="stage"), alt.Tooltip("cost_gap:Q", format=".1e"),
            alt.Tooltip("rms_percent:Q", format=".3~g"), alt.Tooltip("learn_samples:Q", format=".3~s")])
    rule = alt.Chart(source).mark_rule(strokeDash=[5, 4]).encode(y="median(straight_rms_percent):Q")
    return finished(alt.layer(rule, points, *names_beside(base, "name")), None)
