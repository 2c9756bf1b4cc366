"""What the plots of a stream, of an anytime and of a closed-loop race show, as tables.

The deadline profile of a solver is the share of samples that are answered within k sampling periods of their due time; a
latency tail is the response time below which a share of them lies, as far as the sample supports that percentile.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from bench.races.anytime import BUDGETS
from bench.races.rows import PERIOD_US
from bench.report import anytime_figures, loop_report, stream_figures
from bench.report.markdown import settings_label
from bench.report.plot_data import NAMED, together
from bench.timing.percentiles import needed

FLOOR_NAME = "the machine's floor"
DECADES = np.geomspace(0.5, 1e-6, 60)
FARTHEST = 1_000
"""Sampling periods up to which answers are counted."""
WHO = ["view", "name", "solver", "lane"]


def _names(table: pd.DataFrame) -> pd.DataFrame:
    """Names of the lines, with settings and tier where a solver lane has several."""
    several = table.groupby(["solver", "lane"]).tier.transform("nunique") > 1
    settings = table.settings.map(settings_label)
    label = (table.solver + " (" + table.lane + np.where(several, ", " + table.tier, "")
             + np.where(settings != "", ", " + settings, "") + ")")
    return table.assign(name=label.where(~table.is_floor, FLOOR_NAME), view="stream",
                        lane=table.lane.where(~table.is_floor, "the machine"))


def responses(rows: pd.DataFrame, times: pd.DataFrame) -> list[tuple[pd.Series, np.ndarray]]:
    """Sorted response times in µs of every line of the summary that ran on the schedule, quickest first."""
    table = stream_figures.summary(rows, times)
    table = table[table.paced & (table.samples > 0)]
    found = []
    for (_, line), (_, shown) in zip(table.iterrows(), _names(table).iterrows(), strict=True):
        same = np.logical_and.reduce([rows[column] == line[column] for column in stream_figures.GROUP])
        us = np.sort(stream_figures.raw(times, rows[same].task, "response"))
        if us.size:
            found.append((shown, us))
    return sorted(found, key=lambda pair: float(np.quantile(pair[1], 0.99)))


def deadline_profile(rows: pd.DataFrame, times: pd.DataFrame) -> pd.DataFrame:
    """Share of samples answered within k periods, one row a solver lane and k."""
    ks = np.unique(np.geomspace(1, FARTHEST, 40).round()).astype(int)
    parts = [pd.DataFrame(columns=[*WHO, "periods", "share", "samples", "front"])]
    for rank, (line, us) in enumerate(responses(rows, times)):
        parts.append(pd.DataFrame({**line[WHO], "periods": ks, "samples": us.size, "front": rank < NAMED or line.is_floor,
                                   "share": np.searchsorted(us, ks * PERIOD_US, side="right") / us.size}))
    return together(parts)


def latency_tails(rows: pd.DataFrame, times: pd.DataFrame) -> pd.DataFrame:
    """Response time against the share of samples above it."""
    parts = [pd.DataFrame(columns=[*WHO, "one_in", "us", "front"])]
    for rank, (line, us) in enumerate(responses(rows, times)):
        shares = np.array([share for share in DECADES if needed(1.0 - share) <= us.size])
        ranks = np.ceil(np.round((1.0 - shares) * us.size, 6)).astype(int) - 1
        parts.append(pd.DataFrame({**line[WHO], "one_in": 1.0 / shares, "us": us[ranks],
                                   "front": rank < NAMED or line.is_floor}))
    return together(parts)


def anytime(rows: pd.DataFrame) -> pd.DataFrame:
    """Median and worst gap within each budget, one row a curve and budget."""
    table = anytime_figures.summary(rows)
    table = table[np.isfinite(table.median_gap)]
    pace = np.where(table.pace == anytime_figures.PAPER, ", " + table.pace, "")
    view = table.problem_set + ", d = " + table.d.astype(str) + ", " + table.scaling + " data"
    table = table.assign(view=view, name=table.solver + " (" + table.lane + pace + ")", front=False)
    for _, part in table.groupby("view"):
        early = part[part.budget == BUDGETS[0]].nsmallest(NAMED - 1, "median_gap").name
        stepwise = part[part.pace == anytime_figures.PAPER].name
        table.loc[part.index, "front"] = part.name.isin([*early, *stepwise])
    return table[[*WHO, "tier", "pace", "budget", "problems", "median_gap", "worst_gap", "front"]].reset_index(drop=True)


def closed_loop(rows: pd.DataFrame) -> pd.DataFrame:
    """Tracking error against the cost gap of the weights in use, one row a stage and learner."""
    table = loop_report.summary(rows[rows.window >= 0])
    table = table[table.cost_gap.notna()]
    return table.rename(columns={"who": "name"})[
        ["problem", "name", "solver", "lane", "settings", "cost_gap", "rms_percent", "straight_rms_percent", "learn_samples",
         "stale_samples"]].reset_index(drop=True)
