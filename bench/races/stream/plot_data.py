"""What the plots of a stream show, as tables.

The deadline profile of a solver is the share of samples that are answered within k sampling periods of their due time;
a latency tail is the response time below which a share of them lies, as far as the sample supports that percentile.
"""

import numpy as np
import pandas as pd

from bench.races.stream import figures
from bench.report.plot import BEST, together
from bench.report.words import marked, settings_label
from bench.timing import latency_histogram
from bench.timing.percentiles import needed
from bench.timing.schedule import PERIOD_US

FLOOR_NAME = "the machine's floor"
DECADES = np.geomspace(0.5, 1e-6, 60)
FARTHEST = 1_000
"""Sampling periods up to which answers are counted."""
ID_COLUMNS = ["view", "name", "solver", "lane"]


def _names(table: pd.DataFrame) -> pd.DataFrame:
    """Names of the lines, with settings and tier where a solver lane has several."""
    several = table.groupby(["solver", "lane"]).tier.transform("nunique") > 1
    settings = table.settings.map(settings_label)
    label = (
        table.solver.map(marked)
        + " ("
        + table.lane
        + np.where(several, ", " + table.tier, "")
        + np.where(settings != "", ", " + settings, "")
        + ")"
    )
    return table.assign(
        name=label.where(~table.is_floor, FLOOR_NAME),
        view="stream",
        lane=table.lane.where(~table.is_floor, "the machine"),
    )


def responses(rows: pd.DataFrame, times: pd.DataFrame) -> list[tuple[pd.Series, np.ndarray]]:
    """Sorted response times in µs of every line of the summary that ran on the schedule, the machine's floor first and
    then the quickest."""
    table = figures.summary(rows, times)
    table = table[table.paced & (table.samples > 0)]
    found = []
    for (_, line), (_, shown) in zip(table.iterrows(), _names(table).iterrows(), strict=True):
        same = np.logical_and.reduce([rows[column] == line[column] for column in figures.GROUP])
        us = np.sort(figures.raw(times, rows[same].task, "response"))
        if us.size:
            found.append((shown, us))
    return sorted(found, key=lambda pair: (not pair[0].is_floor, float(np.quantile(pair[1], 0.99))))


def deadline_profile(rows: pd.DataFrame, times: pd.DataFrame) -> pd.DataFrame:
    """Share of samples answered within k periods, one row a solver lane and k."""
    ks = np.unique(np.geomspace(1, FARTHEST, 40).round()).astype(int)
    parts = [pd.DataFrame(columns=[*ID_COLUMNS, "periods", "share", "samples", "front"])]
    for rank, (line, us) in enumerate(responses(rows, times)):
        parts.append(
            pd.DataFrame(
                {
                    **line[ID_COLUMNS],
                    "periods": ks,
                    "samples": us.size,
                    "front": rank < BEST,
                    "share": np.searchsorted(us, ks * PERIOD_US, side="right") / us.size,
                }
            )
        )
    return together(parts)


def latency_tails(rows: pd.DataFrame, times: pd.DataFrame) -> pd.DataFrame:
    """Response time against the share of samples above it; of compiled loops, which wait for no schedule, service
    time."""
    parts = [pd.DataFrame(columns=[*ID_COLUMNS, "one_in", "us", "front"])]
    for rank, (line, us) in enumerate(responses(rows, times)):
        shares = np.array([share for share in DECADES if needed(1.0 - share) <= us.size])
        ranks = np.ceil(np.round((1.0 - shares) * us.size, 6)).astype(int) - 1
        parts.append(pd.DataFrame({**line[ID_COLUMNS], "one_in": 1.0 / shares, "us": us[ranks], "front": rank < BEST}))
    table = figures.summary(rows, times)
    loops = _names(table[~table.paced & (table.samples > 0) & (table.solver != "projected_difference")])
    for _, line in loops.iterrows():
        shares = np.array([share for share in DECADES if needed(1.0 - share) <= line.service_samples])
        us = latency_histogram.quantiles(line.service_histogram, 1.0 - shares) / 1e3
        parts.append(
            pd.DataFrame(
                {
                    **line[ID_COLUMNS],
                    "name": f"{line['name']}, service time",
                    "one_in": 1.0 / shares,
                    "us": us,
                    "front": False,
                }
            )
        )
    return together(parts)
