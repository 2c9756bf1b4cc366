"""The interactive plot of a batch race."""

from __future__ import annotations

import altair as alt
import pandas as pd

from bench.report.charts import lines, log


def by_batch(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """Programs a second and core against the batch size."""
    return lines(table, alt.X(**log("batch", "programs in a batch", table.batch)),
                 alt.Y(**log("core_rate", "programs a second and core", table.core_rate)),
                 [alt.Tooltip("name:N"), alt.Tooltip("batch:Q"), alt.Tooltip("core_rate:Q", format=".3~s", title="a second and core"),
                  alt.Tooltip("rate:Q", format=".3~s", title="a second"), alt.Tooltip("share_high:Q", format=".0%", title="right to 1e-9"),
                  alt.Tooltip("gb_s:Q", format=".3~g", title="GB/s")], "core_rate", log_y=True)
