"""Data of the plots of a stream race.

The deadline profile of a solver is the share of samples that are answered within k sampling periods of their due time.
A latency tail is the response time by percentile, as far as the number of samples supports it.
"""

import numpy as np
import pandas as pd

from bench.messages.task import PAPER
from bench.races.stream import summary
from bench.report.plot import BEST, together
from bench.report.words import marked, settings_label
from bench.timing.percentiles import needed
from bench.timing.schedule import PERIOD_US

FLOOR_NAME = "the machine's floor"
DECADES = np.geomspace(0.5, 1e-6, 60)
FARTHEST = 1_000
"""Sampling periods up to which the deadline profile goes."""
ID_COLUMNS = ["view", "name", "solver", "lane"]
Lines = list[tuple[pd.Series, np.ndarray]]
"""Lines of the summary by name, each with its sorted times in µs."""


def _names(table: pd.DataFrame) -> pd.DataFrame:
    """Names of the lines, with the tier if a solver lane has several, and with settings."""
    several = table.groupby(["solver", "lane"]).tier.transform("nunique") > 1
    settings = table.settings.map(settings_label)
    label = (
        table.solver.map(marked)
        + " ("
        + table.lane
        + np.where(several, ", " + table.tier, "")
        + np.where(settings != "", ", " + settings, "")
        + np.where(table.paced, ")", "), service time")
    )
    return table.assign(
        name=label.where(~table.is_floor, FLOOR_NAME),
        view="stream",
        lane=table.lane.where(~table.is_floor, "the machine"),
    )


def lines(table: pd.DataFrame, rows: pd.DataFrame, times: pd.DataFrame) -> Lines:
    """Response times on the schedule, the machine's floor first and then the fastest; then service times of compiled
    loops."""
    there = np.where(table.paced, table.response_samples, table.service_samples)
    ran = table[(there > 0) & (table.paced | (table.solver != PAPER))]
    lines = []
    for (_, line), (_, shown) in zip(ran.iterrows(), _names(ran).iterrows(), strict=True):
        tasks = rows.task[(rows[summary.GROUP] == line[summary.GROUP]).all(axis=1)]
        lines.append((shown, np.sort(summary.raw(times, tasks, "response" if line.paced else "service"))))
    return sorted(lines, key=lambda pair: (not pair[0].paced, not pair[0].is_floor, float(np.quantile(pair[1], 0.99))))


def deadline_profile(lines: Lines) -> pd.DataFrame:
    """Share of samples answered within k periods, one row per solver lane and k."""
    ks = np.unique(np.geomspace(1, FARTHEST, 40).round()).astype(int)
    return together(
        [pd.DataFrame(columns=[*ID_COLUMNS, "periods", "share", "samples", "front"])]
        + [
            pd.DataFrame(
                {
                    **line[ID_COLUMNS],
                    "periods": ks,
                    "samples": us.size,
                    "front": rank < BEST,
                    "share": np.searchsorted(us, ks * PERIOD_US, side="right") / us.size,
                }
            )
            for rank, (line, us) in enumerate(lines)
            if line.paced
        ]
    )


def latency_tails(lines: Lines) -> pd.DataFrame:
    """Response time against the share of samples above it; service time for compiled loops."""
    parts = [pd.DataFrame(columns=[*ID_COLUMNS, "one_in", "us", "front"])]
    for rank, (line, us) in enumerate(lines):
        shares = np.array([share for share in DECADES if needed(1.0 - share) <= us.size])
        ranks = np.ceil(np.round((1.0 - shares) * us.size, 6)).astype(int) - 1
        tail = {"one_in": 1.0 / shares, "us": us[ranks], "front": rank < BEST and line.paced}
        parts.append(pd.DataFrame({**line[ID_COLUMNS], **tail}))
    return together(parts)
