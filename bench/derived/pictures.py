"""Tables of the figures of a race.

All are of cold starts. Except in the work–precision picture, each solver lane has one setting for all problems: that of
the tier 1e-9, or the one that is right on most problems. A *view* is one problem set in one scaling. Times are those of
`bench.messages.columns`.

The performance profile of Dolan and Moré over the problems p of a view, with t_p,s infinite if s was not right:

    ρ_s(τ) = share of the p with t_p,s ≤ τ · min over all solvers of t_p

Source: E. D. Dolan and J. J. Moré, Mathematical Programming 91 (2002) 201 to 213.
"""

import numpy as np
import pandas as pd

from bench.derived import ranking
from bench.derived.measurements import Measurements, at_tiers
from bench.derived.tiers import LANE, distance
from bench.messages.columns import TYPICAL, worst
from bench.messages.task import PAPER, Tier
from bench.report.report import BEST, LEAST_GAP
from bench.report.words import marked

NAMED = 10
"""Number of the best lines that are named."""
MOST_GAP = 1e3
"""Largest gap on a plot; larger ones are drawn at this value."""
MOST_IN_PROFILE = 10


def work_precision(measurements: Measurements) -> pd.DataFrame:
    """Worst gap or violation, timed answers included, against the time of an answer, one row per solver and setting
    that answers all its problems, in the lane that is the best of the solver in the short table.

    A lane of a user's own file is always there if it was timed. ``is_default`` marks the library's own settings, and
    ``front`` the lines that are named: the NAMED best by the short table, a user's own, and the paper's method, drawn
    at its own pace of one step per sampling period. At ``end`` stands the name: at the setting of the tier by which the
    short table ranks the lane, or else at the most exact one.
    """
    rows = measurements.lanes[measurements.lanes.start == "cold"]
    rows = ranking.with_pace(rows.assign(gap=distance(rows), own=measurements.is_own(rows)))
    tiers = measurements.settings[measurements.settings.tier.isin(ranking.ORDER)]
    ranks = tiers.assign(place=tiers.tier.map([*ranking.ORDER].index)).groupby([*LANE, "setting"]).place.min()
    table = (
        rows.assign(name=rows.name.mask(rows.own, rows.name + " (" + rows.lane + ")"))
        .groupby(["name", "scaling", "solver", "lane", "rung", "setting", "is_default", "own"])
        .agg(
            problems=("problem", "size"),
            worst_gap=("gap", worst),
            answer_us=("answer_us", TYPICAL),
            settings=("settings", "first"),
        )
        .reset_index()
        .join(ranks, on=[*LANE, "setting"])
        .fillna({"place": len(ranking.ORDER)})
    )
    answered = np.isfinite(table.worst_gap) & (table.problems == table.problems.max())
    table = table[(answered | table.own) & table.answer_us.notna()]
    ends = table.assign(least=table.worst_gap.where(table.place == len(ranking.ORDER), 0.0))
    ends = ends.sort_values(["place", "least", "answer_us"]).drop_duplicates(["scaling", "name", "lane"])
    best = ends.sort_values(["place", "answer_us"]).drop_duplicates(["scaling", "name"])
    best = best.assign(front=(best.groupby("scaling").cumcount() < NAMED) | best.own | (best.name == ranking.PACE))
    table = table.merge(best[["scaling", "name", "lane", "setting", "front"]], on=["scaling", "name", "lane"])
    table = table.assign(
        view=table.scaling + " data",
        end=table.setting_x == table.setting_y,
        drawn=np.clip(table.worst_gap, LEAST_GAP, MOST_GAP),
    )
    return table.drop(columns=["setting_x", "setting_y", "place", "own"]).sort_values(
        ["scaling", "name", "rung"], ascending=[False, True, True], ignore_index=True
    )


def _timed(measurements: Measurements) -> pd.DataFrame:
    """Rows at the setting for 1e-9 or the nearest to it, with ``time_us``, infinite if the answer is not right, and
    whether they are of a user's ``own`` file.

    The paper's method, whose settings are numbers of steps, is left out.
    """
    rows = measurements.lanes[measurements.lanes.start == "cold"]
    table = at_tiers(rows, measurements.settings, "furthest")
    table = table[(table.tier == Tier.HIGH) & (table.solver != PAPER)]
    return table.assign(
        view=table.problem_set + ", " + table.scaling + " data",
        name=table.solver.map(marked) + " (" + table.lane + ")",
        time_us=table.answer_us.where(table.right, np.inf).fillna(np.inf),
        own=measurements.is_own(table),
    )


def performance_profile(measurements: Measurements) -> pd.DataFrame:
    """ρ_s(τ), one row per step of the function, for the solvers with the smallest mean of log τ over the problems, and
    a user's own."""
    steps = []
    for view, group in _timed(measurements).groupby("view", sort=False):
        times = group.pivot_table(index="problem", columns="name", values="time_us", aggfunc="min", dropna=False)
        ratios = times.div(times.min(axis=1), axis=0).where(np.isfinite(times)).dropna(how="all")
        if ratios.empty:
            continue
        logs = np.log(ratios.fillna(10.0 * float(np.nanmax(ratios))))
        best = ratios[logs.mean().nsmallest(MOST_IN_PROFILE).index].dropna(axis="columns", how="all")
        ratios = ratios[best.columns.append(pd.Index(group.loc[group.own, "name"])).unique()]
        lanes = group.drop_duplicates("name").set_index("name")[["solver", "lane"]]
        for name, column in ratios.items():
            factors = np.unique([1.0, *column.dropna(), np.nanmax(ratios)])
            shares = [(column <= factor).sum() / len(times) for factor in factors]
            of_name = {"view": view, "name": name, **lanes.loc[name]}
            steps.append(pd.DataFrame({**of_name, "factor": factors, "share": shares}))
    return pd.concat(steps, ignore_index=True) if steps else pd.DataFrame()


def sizes(measurements: Measurements) -> pd.DataFrame:
    """Median time of an answer by number of unknowns, if all answers of that size are right; empty if
    there is one size."""
    table = _timed(measurements)
    table = table[table.groupby("view").d.transform("nunique") > 1]
    lines = (
        table.groupby(["view", "name", "solver", "lane", "own", "d"], sort=False)
        .agg(problems=("time_us", "size"), time_us=("time_us", TYPICAL), worst=("time_us", "max"))
        .reset_index()
    )
    lines = lines[np.isfinite(lines.worst)].drop(columns="worst")
    of_name = np.log(lines.time_us).groupby([lines["view"], lines.name])
    missing = lines.groupby("view").d.transform("nunique") - of_name.transform("size")
    place = (1e3 * missing + of_name.transform("mean")).groupby(lines["view"]).rank(method="dense")
    return lines.assign(place=place, front=lines.pop("own") | (place <= BEST)).sort_values(
        ["view", "place"], kind="stable", ignore_index=True
    )
