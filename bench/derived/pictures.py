"""What the figures of a one-shot race show, computed here once as tables.

All are of cold starts. But for the work–precision picture, each solver lane has one setting for all problems: that
which stands for 1e-9, or where none does, the one that is right on most problems. A *view* is one problem set in one
scaling. The time of an answer is the median of update plus the median of solve.

The performance profile of Dolan and Moré over the problems p of a view, with t_p,s infinite where s was not right:

    ρ_s(τ) = share of the p with t_p,s ≤ τ · min over all solvers of t_p

Source: E. D. Dolan and J. J. Moré, Mathematical Programming 91 (2002) 201 to 213.
"""

import numpy as np
import pandas as pd

from bench.derived import ranking, summary
from bench.derived.accuracy import TOLERANCE, worst
from bench.derived.measurements import Measurements, at_tiers
from bench.report.plot import BEST, LEAST_GAP, together
from bench.report.words import MARK, duration, marked
from bench.timing.schedule import PERIOD_US
from solvers import Lane, Status, Tier
from solvers.registry import FAMILIES, OURS

MOST_EXACT = [str(tier) for tier in (Tier.HIGH, Tier.EXACT, Tier.MID, Tier.LOW, Tier.DEFAULT, Tier.STAGE)]
MOST_GAP = 1e3
"""Cost gaps above this are drawn at it."""
OUR_LINES, OTHER_LINES = f"ours {MARK}", "by others"
EXACT, OTHERS = ("box_active_set", "recursive_active_set"), 5
"""Whose time by size stands in the report beside that of how many others."""
MOST_IN_PROFILE, MOST_BARS = 10, 24
STAGES = ("set-up", "update", "solve")


def named(table: pd.DataFrame) -> pd.DataFrame:
    """The table with its views and with names of solver lanes."""
    return table.assign(
        view=table.problem_set + ", " + table.scaling + " data",
        name=table.solver.map(marked) + " (" + table.lane + ")",
        stepping=table.settings.str.contains('"steps"'),
    )


def ranked(table: pd.DataFrame, score: pd.Series) -> pd.DataFrame:
    """The lines of each view by the least score of their rows, the best first, and ``front``, whether a line is among
    the BEST."""
    names = table.assign(score=score).groupby(["view", "name"]).score.min().sort_values(kind="stable")
    place = names.groupby(level="view").cumcount()
    at = place.reindex(pd.MultiIndex.from_frame(table[["view", "name"]])).to_numpy()
    views = table["view"].map({view: i for i, view in enumerate(dict.fromkeys(table["view"]))})
    return (
        table.assign(views=views, at=at, front=at < BEST)
        .sort_values(["views", "at"], kind="stable", ignore_index=True)
        .drop(columns=["views", "at"])
    )


def work_precision(found: Measurements) -> pd.DataFrame:
    """Worst cost gap against the time of an answer, one row a solver lane and setting that answers every problem that
    the lane was asked.

    ``is_default`` marks the library's own settings. The paper's method is there once more at its own pace, a step a
    sampling period; it comes first, and then the others by their time to a gap of 1e-9.
    """
    rows = found.field[found.field.start == "cold"]
    rows = rows.assign(cost_gap=rows.cost_gap.where(rows.status == Status.OK))
    table = (
        rows.groupby(["scaling", "solver", "lane", "rung", "setting", "is_default"])
        .agg(
            problems=("problem", "size"),
            worst_cost_gap=("cost_gap", worst),
            total_us=("total_us", "median"),
            steps=("periods", "median"),
            settings=("settings", "first"),
        )
        .reset_index()
    )
    pace = table[(table.solver == ranking.PAPER) & (table.lane == ranking.lane_of_paper(table))]
    table = pd.concat(
        [
            table.assign(label=np.where(table.solver.isin(OURS), OUR_LINES, OTHER_LINES)),
            pace.assign(total_us=pace.steps * PERIOD_US, label=ranking.PACE),
        ],
        ignore_index=True,
    )
    table = table[table.worst_cost_gap.notna() & table.total_us.notna()]
    name = table.solver.map(marked) + np.where(table.lane == Lane.DIRECT, "", " (" + table.lane + ")")
    groups = np.where(table.lane.isin([str(lane) for lane in FAMILIES]), "qpsolvers and cvxpy", "without wrappers")
    table = table.assign(
        name=name.where(table.label != ranking.PACE, ranking.PACE), view=table.scaling + " data, " + groups
    )
    table = table.sort_values(
        ["scaling", "view", "label", "name", "rung"], ascending=[False, False, True, True, True], ignore_index=True
    )
    time = table.total_us.where(table.worst_cost_gap <= TOLERANCE[Tier.HIGH], 1e9 * (1.0 + table.worst_cost_gap))
    table = ranked(
        table.assign(drawn=np.clip(table.worst_cost_gap, LEAST_GAP, MOST_GAP)),
        time.where(table.label != ranking.PACE, 0.0),
    )
    return table[
        [
            "view",
            "scaling",
            "label",
            "name",
            "solver",
            "lane",
            "rung",
            "is_default",
            "settings",
            "problems",
            "worst_cost_gap",
            "total_us",
            "drawn",
            "front",
        ]
    ]


def _timed(found: Measurements) -> pd.DataFrame:
    """Rows at 1e-9, or at the setting that comes nearest to it, with the time of an answer, infinite where it is not
    right.

    Those that count steps are left out.
    """
    rows = found.field[found.field.start == "cold"]
    table = named(at_tiers(rows, found.settings, "furthest"))
    table = table[(table.tier == Tier.HIGH) & ~table.stepping].drop(columns="stepping")
    return table.assign(time_us=table.total_us.where(table.right, np.inf).fillna(np.inf))


def performance_profile(found: Measurements) -> pd.DataFrame:
    """ρ_s(τ) at its steps, one row a step, of the solvers that are best in the mean over the problems of log τ."""
    steps_of = [pd.DataFrame(columns=["view", "name", "solver", "lane", "factor", "share"])]
    for view, part in _timed(found).groupby("view", sort=False):
        times = part.pivot_table(index="problem", columns="name", values="time_us", aggfunc="min", dropna=False)
        ratios = times.div(times.min(axis=1), axis=0).where(np.isfinite(times)).dropna(how="all")
        if ratios.empty:
            continue
        logs = np.log(ratios.fillna(10.0 * float(np.nanmax(ratios))))
        ratios = ratios[logs.mean().nsmallest(MOST_IN_PROFILE).index]
        lanes = part.drop_duplicates("name").set_index("name")[["solver", "lane"]]
        for name, column in ratios.items():
            steps = column.dropna()
            if len(steps):
                factors = np.unique([1.0, *steps, np.nanmax(ratios)])
                shares = [(steps <= factor).sum() / len(times) for factor in factors]
                of_name = {"view": view, "name": name, **lanes.loc[name], "factor": factors, "share": shares}
                steps_of.append(pd.DataFrame(of_name))
    return together(steps_of)


def sizes(found: Measurements) -> pd.DataFrame:
    """Median time of an answer by number of unknowns, where all answers of the size were right; none for one size
    only."""
    table = _timed(found)
    table = table[table.groupby("view").d.transform("nunique") > 1]
    lines = (
        table.groupby(["view", "name", "solver", "lane", "d"], sort=False)
        .agg(problems=("time_us", "size"), time_us=("time_us", "median"), worst=("time_us", "max"))
        .reset_index()
    )
    lines = lines[np.isfinite(lines.worst)].drop(columns="worst")
    of_name = lines.groupby(["view", "name"]).time_us
    missing = lines.groupby("view").d.transform("nunique") - of_name.transform("size")
    return ranked(lines, 1e3 * missing + np.log(lines.time_us).groupby([lines["view"], lines.name]).transform("mean"))


def time_by_size(found: Measurements) -> pd.DataFrame:
    """Of :func:`sizes`, our exact solvers and the fastest others in their fastest lane: view, name, then a column a
    size.

    Fastest are those with right answers at most sizes, and among them by the geometric mean over the sizes.
    """
    table = sizes(found)
    if not len(table):
        return table
    wide = table.pivot_table(index=["view", "solver", "name"], columns="d", values="time_us").reset_index()
    times = wide[sorted(set(table.d))]
    wide = wide.assign(ours=wide.solver.isin(EXACT), right=times.notna().sum(axis=1), mean=np.log(times).mean(axis=1))
    wide = wide.sort_values(["view", "ours", "right", "mean"], ascending=[True, False, False, True])
    others = wide[~wide.ours].drop_duplicates(["view", "solver"]).groupby("view").head(OTHERS)
    shown = pd.concat([wide[wide.ours], others]).sort_values(["view", "ours"], ascending=[True, False], kind="stable")
    return shown.drop(columns=["solver", "ours", "right", "mean"]).rename_axis(columns=None).reset_index(drop=True)


def stages(table: pd.DataFrame) -> pd.DataFrame:
    """Where the time goes, one row a solver lane and stage, the fastest first: medians in µs, and shares of their sum.

    Of a summary, the fastest of each lane in each view at the most exact tier that they reach.
    """
    table = named(summary.raced(table))
    table = table[table.solve_us_p50.notna() & ~table.stepping]
    rank = table.tier.map(MOST_EXACT.index)
    best = table[rank == rank.groupby([table.view, table.name]).transform("min")].sort_values("total_us", kind="stable")
    best = best.groupby(["view", "lane"], sort=False).head(MOST_BARS)
    found = [
        {
            **{name: line[name] for name in ("view", "name", "solver", "lane", "tier")},
            "stage": stage,
            "us": us,
            "share": us / (line["setup_us"] + line["total_us"]),
            "update_and_solve_us": line["total_us"],
            "label": f"{marked(line['solver'])}, {duration(line['total_us'])}",
            "at": at,
        }
        for line in best.to_dict("records")
        for at, (stage, us) in enumerate(
            zip(STAGES, (line["setup_us"], line["update_us"], line["solve_us_p50"]), strict=True)
        )
    ]
    return pd.DataFrame(
        found,
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
