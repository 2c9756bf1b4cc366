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

from bench.derived import ranking, summary, verdict
from bench.derived.measurements import Measurements, at_tiers
from bench.derived.tiers import distance
from bench.messages.columns import TYPICAL, worst
from bench.messages.task import Tier
from bench.report.report import BEST, LEAST_GAP, together
from bench.report.words import MARK, duration, marked
from solvers.registry import OURS

MOST_EXACT = [str(tier) for tier in (Tier.HIGH, Tier.EXACT, Tier.MID, Tier.LOW, Tier.DEFAULT, Tier.STAGE)]
OUR_BEST = "box_active_set"
MOST_GAP = 1e3
"""Largest gap on a plot; larger ones are drawn at this value."""
OUR_LINES, OTHER_LINES = f"ours {MARK}", "by others"
MOST_IN_PROFILE, MOST_BARS = 10, 24
STAGES = ("set-up", "update", "solve")


def named(table: pd.DataFrame) -> pd.DataFrame:
    """The table with ``view``, ``name`` of the solver lane, and whether its settings count steps."""
    return table.assign(
        view=table.problem_set + ", " + table.scaling + " data",
        name=table.solver.map(marked) + " (" + table.lane + ")",
        stepping=table.settings.str.contains('"steps"'),
    )


def ranked(table: pd.DataFrame, score: pd.Series) -> pd.DataFrame:
    """The lines of each view sorted by the smallest score of their rows; ``front`` marks the BEST of them."""
    names = table.assign(score=score).groupby(["view", "name"]).score.min().sort_values(kind="stable")
    place = names.groupby(level="view").cumcount()
    at = place.reindex(pd.MultiIndex.from_frame(table[["view", "name"]])).to_numpy()
    views = pd.factorize(table["view"])[0]
    return (
        table.assign(views=views, at=at, front=at < BEST)
        .sort_values(["views", "at"], kind="stable", ignore_index=True)
        .drop(columns=["views", "at"])
    )


def work_precision(measurements: Measurements) -> pd.DataFrame:
    """Worst gap or violation, timed answers included, against the time of an answer, one row per solver and setting
    that answers all its problems, in the lane in which the solver is the fastest at its most exact setting.

    ``is_default`` marks the library's own settings, ``front`` the lines that are named, and ``end`` the setting at
    which the name stands. The paper's method is drawn at its own pace, one step per sampling period.
    """
    rows = measurements.field[measurements.field.start == "cold"]
    rows = ranking.with_pace(rows.assign(gap=distance(rows)))
    table = (
        rows.groupby(["name", "scaling", "solver", "lane", "rung", "setting", "is_default"])
        .agg(
            problems=("problem", "size"),
            worst_gap=("gap", worst),
            answer_us=("answer_us", TYPICAL),
            settings=("settings", "first"),
        )
        .reset_index()
    )
    paced = table.name == ranking.PACE
    table = table.assign(label=np.where(paced, ranking.PACE, np.where(table.solver.isin(OURS), OUR_LINES, OTHER_LINES)))
    table = table[np.isfinite(table.worst_gap) & table.answer_us.notna() & (table.problems == table.problems.max())]
    line = ["scaling", "label", "solver"]
    end = table.sort_values(["worst_gap", "answer_us"]).drop_duplicates([*line, "lane"])
    best = end.sort_values("answer_us").drop_duplicates(line)
    table = table.merge(best[[*line, "lane"]], on=[*line, "lane"])
    ends = pd.MultiIndex.from_frame(best[[*line, "setting"]])
    table = table.assign(
        view=table.scaling + " data",
        front=(table.label == ranking.PACE) | table.solver.isin((*verdict.KNOWN, OUR_BEST)),
        end=pd.MultiIndex.from_frame(table[[*line, "setting"]]).isin(ends),
        drawn=np.clip(table.worst_gap, LEAST_GAP, MOST_GAP),
    )
    columns = ["view", "scaling", "label", "name", "solver", "lane", "rung", "is_default", "settings", "problems"]
    return table.sort_values(["scaling", "name", "rung"], ascending=[False, True, True], ignore_index=True)[
        [*columns, "worst_gap", "answer_us", "drawn", "front", "end"]
    ]


def _timed(measurements: Measurements) -> pd.DataFrame:
    """Rows at the setting for 1e-9 or the nearest to it, with ``time_us``, infinite if the answer is not right.

    Methods whose settings count steps are left out.
    """
    rows = measurements.field[measurements.field.start == "cold"]
    table = named(at_tiers(rows, measurements.settings, "furthest"))
    table = table[(table.tier == Tier.HIGH) & ~table.stepping].drop(columns="stepping")
    return table.assign(time_us=table.answer_us.where(table.right, np.inf).fillna(np.inf))


def performance_profile(measurements: Measurements) -> pd.DataFrame:
    """ρ_s(τ), one row per step of the function, for the solvers with the smallest mean of log τ over the problems."""
    steps_of = [pd.DataFrame(columns=["view", "name", "solver", "lane", "factor", "share"])]
    for view, part in _timed(measurements).groupby("view", sort=False):
        times = part.pivot_table(index="problem", columns="name", values="time_us", aggfunc="min", dropna=False)
        ratios = times.div(times.min(axis=1), axis=0).where(np.isfinite(times)).dropna(how="all")
        if ratios.empty:
            continue
        logs = np.log(ratios.fillna(10.0 * float(np.nanmax(ratios))))
        ratios = ratios[logs.mean().nsmallest(MOST_IN_PROFILE).index].dropna(axis="columns", how="all")
        lanes = part.drop_duplicates("name").set_index("name")[["solver", "lane"]]
        for name, column in ratios.items():
            factors = np.unique([1.0, *column.dropna(), np.nanmax(ratios)])
            shares = [(column <= factor).sum() / len(times) for factor in factors]
            of_name = {"view": view, "name": name, **lanes.loc[name], "factor": factors, "share": shares}
            steps_of.append(pd.DataFrame(of_name))
    return together(steps_of)


def sizes(measurements: Measurements) -> pd.DataFrame:
    """Median time of an answer by number of unknowns, if all answers of that size are right; empty if
    there is one size."""
    table = _timed(measurements)
    table = table[table.groupby("view").d.transform("nunique") > 1]
    lines = (
        table.groupby(["view", "name", "solver", "lane", "d"], sort=False)
        .agg(problems=("time_us", "size"), time_us=("time_us", TYPICAL), worst=("time_us", "max"))
        .reset_index()
    )
    lines = lines[np.isfinite(lines.worst)].drop(columns="worst")
    of_name = lines.groupby(["view", "name"]).time_us
    missing = lines.groupby("view").d.transform("nunique") - of_name.transform("size")
    return ranked(lines, 1e3 * missing + np.log(lines.time_us).groupby([lines["view"], lines.name]).transform("mean"))


def stages(table: pd.DataFrame) -> pd.DataFrame:
    """Time of set-up, update and solve, one row per solver lane and stage, the fastest first: medians in µs and shares.

    They are the fastest of each lane and view in a summary, at the most accurate tier that they reach.
    """
    table = named(summary.raced(table))
    table = table[table.solve_us_p50.notna() & ~table.stepping]
    rank = table.tier.map(MOST_EXACT.index)
    best = (
        table[rank == rank.groupby([table.view, table.name]).transform("min")]
        .sort_values("answer_us", kind="stable")
        .groupby(["view", "lane"], sort=False)
        .head(MOST_BARS)
    )
    rows = [
        {
            **{name: line[name] for name in ("view", "name", "solver", "lane", "tier")},
            "stage": stage,
            "us": us,
            "share": us / (line["setup_us"] + line["answer_us"]),
            "update_and_solve_us": line["answer_us"],
            "label": f"{marked(line['solver'])}, {duration(line['answer_us'])}",
            "at": at,
        }
        for line in best.to_dict("records")
        for at, (stage, us) in enumerate(
            zip(STAGES, (line["setup_us"], line["update_us"], line["solve_us_p50"]), strict=True)
        )
    ]
    return pd.DataFrame(
        rows,
        columns=[
            "view",
            "name",
            "solver",
            "lane",
            "tier",
            "stage",
            "us",
            "share",
            "update_and_solve_us",
            "label",
            "at",
        ],
    )
