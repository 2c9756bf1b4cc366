"""What the plots of a one-shot race show, computed here once as tables; `charts`, `plots` and the CSV beside them render it.

All are of cold starts. But for the work–precision picture, each solver lane has one setting for all problems: that which stands for 1e-9,
or where none does, the one that is right on most problems. A *view* is one problem set in one scaling. The time of an answer is the median of
update plus the median of solve.

The performance profile of Dolan and Moré over the problems p of a view, with t_p,s infinite where s was not right:

    ρ_s(τ) = share of the p with t_p,s ≤ τ · min over all solvers of t_p

Source: E. D. Dolan and J. J. Moré, Mathematical Programming 91 (2002) 201 to 213.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from bench.derived import ranking, summary
from bench.derived.accuracy import worst
from bench.derived.measurements import Measurements, at_tiers
from bench.report.charts import LEAST_GAP, NAMED, together
from bench.report.words import MARK, marked
from bench.timing.schedule import PERIOD_US
from solvers import Lane, Status, Tier
from solvers.registry import FAMILIES, OURS

MOST_EXACT = [str(tier) for tier in (Tier.HIGH, Tier.EXACT, Tier.MID, Tier.LOW, Tier.DEFAULT, Tier.STAGE)]
OUR_LINES, OTHER_LINES = f"ours {MARK}", "by others"
EXACT, OTHERS = ("box_active_set", "recursive_active_set"), 5
"""Whose time by size stands in the report beside that of how many others."""
STAGES = ("set-up", "update", "solve")


def named(table: pd.DataFrame) -> pd.DataFrame:
    """The table with its views and with names of solver lanes."""
    return table.assign(view=table.problem_set + ", " + table.scaling + " data",
                        name=table.solver.map(marked) + " (" + table.lane + ")", stepping=table.settings.str.contains('"steps"'))


def front(table: pd.DataFrame, *costs: str) -> pd.Series:
    """Whether no other row of the view is at least as good in every cost and better in one."""
    on_front = pd.Series(False, index=table.index)
    for _, part in table.groupby("view"):
        values = part[list(costs)].to_numpy()
        for index, line in zip(part.index, values, strict=True):
            beaten = np.all(values <= line, axis=1) & np.any(values < line, axis=1)
            on_front[index] = not beaten.any()
    return on_front


def work_precision(found: Measurements) -> pd.DataFrame:
    """Worst cost gap against the time of an answer, one row a solver lane and setting that answers every problem that the lane was asked.

    ``is_default`` marks what the library does unasked. The paper's method is there once more at its own pace, a step a sampling period.
    """
    rows = found.field[found.field.start == "cold"]
    rows = rows.assign(total_us=rows.update_us + rows.solve_us_p50, cost_gap=rows.cost_gap.where(rows.status == Status.OK))
    table = rows.groupby(["scaling", "solver", "lane", "rung", "setting", "is_default"]).agg(
        problems=("problem", "size"), worst_cost_gap=("cost_gap", worst), total_us=("total_us", "median"),
        steps=("periods", "median"), settings=("settings", "first")).reset_index()
    pace = table[(table.solver == ranking.PAPER) & (table.lane == ranking.lane_of_paper(table))]
    table = pd.concat([table.assign(who=np.where(table.solver.isin(OURS), OUR_LINES, OTHER_LINES)),
                       pace.assign(total_us=pace.steps * PERIOD_US, who=ranking.PACE)], ignore_index=True)
    table = table[table.worst_cost_gap.notna() & table.total_us.notna()]
    name = table.solver.map(marked) + np.where(table.lane == Lane.DIRECT, "", " (" + table.lane + ")")
    groups = np.where(table.lane.isin([str(lane) for lane in FAMILIES]), "qpsolvers and cvxpy", "without wrappers")
    table = table.assign(name=name.where(table.who != ranking.PACE, ranking.PACE), view=table.scaling + " data, " + groups)
    table = table.sort_values(["scaling", "view", "who", "name", "rung"], ascending=[False, False, True, True, True], ignore_index=True)
    table["front"] = front(table.assign(drawn=np.maximum(table.worst_cost_gap, LEAST_GAP)), "total_us", "drawn") | (table.who == ranking.PACE)
    return table[["view", "scaling", "who", "name", "solver", "lane", "rung", "is_default", "settings", "problems", "worst_cost_gap",
                  "total_us", "front"]]


def _timed(found: Measurements) -> pd.DataFrame:
    """Rows at 1e-9, or at the setting that comes nearest to it, with the time of an answer, infinite where it is not right.

    Those that count steps are left out.
    """
    rows = found.field[found.field.start == "cold"]
    table = named(at_tiers(rows, found.settings, "furthest"))
    table = table[(table.tier == Tier.HIGH) & ~table.stepping].drop(columns="stepping")
    return table.assign(time_us=(table.update_us + table.solve_us_p50).where(table.right, np.inf).fillna(np.inf))


def performance_profile(found: Measurements) -> pd.DataFrame:
    """ρ_s(τ) at its steps, one row a step; those that are never right have none."""
    steps_of = [pd.DataFrame(columns=["view", "name", "solver", "lane", "factor", "share", "front"])]
    for view, part in _timed(found).groupby("view", sort=False):
        times = part.pivot_table(index="problem", columns="name", values="time_us", aggfunc="min", dropna=False)
        best = times.min(axis=1)
        ratios = times[np.isfinite(best)].div(best[np.isfinite(best)], axis=0)
        if ratios.empty:
            continue
        worst = float(np.max(ratios.to_numpy()[np.isfinite(ratios.to_numpy())]))
        near = np.log(ratios.replace(np.inf, 10.0 * worst)).mean().nsmallest(NAMED).index
        lanes = part.drop_duplicates("name").set_index("name")[["solver", "lane"]]
        for name, column in ratios.items():
            steps = np.sort(column[np.isfinite(column)].to_numpy())
            if steps.size:
                factors = np.unique(np.concatenate([[1.0], steps, [worst]]))
                shares = np.searchsorted(steps, factors, side="right") / len(times)
                steps_of.append(pd.DataFrame({"view": view, "name": name, "solver": lanes.solver[name],
                                           "lane": lanes.lane[name], "factor": factors, "share": shares,
                                           "front": name in near}))
    return together(steps_of)


def sizes(found: Measurements) -> pd.DataFrame:
    """Median time of an answer by number of unknowns, where all answers of the size were right; none for one size only."""
    table = _timed(found)
    table = table[table.groupby("view").d.transform("nunique") > 1]
    lines = table.groupby(["view", "name", "solver", "lane", "d"], sort=False).agg(
        problems=("time_us", "size"), time_us=("time_us", "median"), worst=("time_us", "max")).reset_index()
    lines = lines[np.isfinite(lines.worst)].drop(columns="worst")
    fastest = lines.groupby(["view", "d"]).time_us.transform("min") if len(lines) else lines.d
    winners = lines[lines.time_us == fastest].groupby("view").name.agg(set)
    lines["front"] = [name in winners[view] for view, name in zip(lines["view"], lines["name"], strict=True)]
    return lines.reset_index(drop=True)


def time_by_size(found: Measurements) -> pd.DataFrame:
    """Of :func:`sizes`, our exact solvers and the fastest others in their fastest lane: view, name, then a column a size.

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
    """Where the time goes, one row a solver lane and stage: medians in µs, and shares of their sum.

    Of a summary, each solver lane in each view at the most exact tier that it reaches.
    """
    table = named(summary.raced(table))
    table = table[table.solve_us_p50.notna() & ~table.stepping]
    rank = table.tier.map(MOST_EXACT.index)
    best = table[rank == rank.groupby([table.view, table.name]).transform("min")]
    found = [{**{name: line[name] for name in ("view", "name", "solver", "lane", "tier")}, "stage": stage, "us": us,
              "share": us / (line["setup_us"] + line["total_us"]), "update_and_solve_us": line["total_us"]}
             for line in best.to_dict("records")
             for stage, us in zip(STAGES, (line["setup_us"], line["update_us"], line["solve_us_p50"]), strict=True)]
    return pd.DataFrame(found, columns=["view", "name", "solver", "lane", "tier", "stage", "us", "share", "update_and_solve_us"])
