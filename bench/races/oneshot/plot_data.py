"""What the plots of a one-shot race show, computed here once as tables; `charts`, `plots` and the CSV beside them render it.

All are of cold starts. But for the work–precision picture, where it has a line over its rungs, each solver lane stands for itself
at the most exact tier that it raced, and a *view* is one problem set in one scaling. The time of an answer is the median of update
plus the median of solve.

The performance profile of Dolan and Moré over the problems p of a view, with t_p,s infinite where s was not right:

    ρ_s(τ) = share of the p with t_p,s ≤ τ · min over all solvers of t_p

Source: E. D. Dolan and J. J. Moré, Mathematical Programming 91 (2002) 201 to 213.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from bench.races import null_solver
from bench.races.calibration import IN_LANE_DIRECT, SEARCHED
from bench.races.metrics import worst
from bench.races.oneshot import figures, ranking
from bench.report.charts import LEAST_GAP, NAMED, together
from bench.report.words import MARK, marked
from bench.timing.schedule import PERIOD_US
from solvers import Lane, Status, Tier
from solvers.registry import OURS

MOST_EXACT = [str(tier) for tier in (Tier.HIGH, Tier.EXACT, Tier.MID, Tier.LOW, Tier.DEFAULT, Tier.STAGE)]
OUR_LINES, OTHER_LINES = f"ours {MARK}", "by others"
EXACT, OTHERS = ("box_active_set", "recursive_active_set"), 5
"""Whose time by size stands in the report beside that of how many others."""
STAGES = ("set-up", "update", "solve", "wrapper")


def named(table: pd.DataFrame) -> pd.DataFrame:
    """The table with its views and with names of solver lanes."""
    return table.assign(view=table.problem_set + ", " + table.scaling + " data",
                        name=table.solver.map(marked) + " (" + table.lane + ")", stepping=table.settings.str.contains('"steps"'))


def most_exact(table: pd.DataFrame) -> pd.DataFrame:
    """Of each solver lane in each view the rows of its most exact tier; those that count steps are left out."""
    table = named(figures.at_tiers(table))
    table = table[~table.stepping]
    rank = table.tier.map(MOST_EXACT.index)
    best = rank.groupby([table.view, table.name]).transform("min")
    return table[rank == best].drop(columns="stepping").reset_index(drop=True)


def front(table: pd.DataFrame, *costs: str) -> pd.Series:
    """Whether no other row of the view is at least as good in every cost and better in one."""
    on_front = pd.Series(False, index=table.index)
    for _, part in table.groupby("view"):
        values = part[list(costs)].to_numpy()
        for index, line in zip(part.index, values, strict=True):
            beaten = np.all(values <= line, axis=1) & np.any(values < line, axis=1)
            on_front[index] = not beaten.any()
    return on_front


def work_precision(rows: pd.DataFrame) -> pd.DataFrame:
    """Worst cost gap against the time of an answer, one row a solver lane and rung; ``unasked`` marks what the library does by default.

    Rungs that serve the picture alone are timed on a part of the problems, so it has no others where there are such. The paper's
    method is there once more at its own pace, a step a sampling period.
    """
    rows = rows[(rows.solver != null_solver.ENTRY.name) & (rows.start == "cold")]
    extra = rows[rows.tier == Tier.RUNG]
    if len(extra):
        which = ["problem_set", "problem", "scaling"]
        partly = rows.scaling.isin(extra.scaling)
        rows = pd.concat([rows[partly].merge(extra[which].drop_duplicates(), on=which), rows[~partly]], ignore_index=True)
    rows = rows.assign(unasked=rows.task.isin(rows.task[rows.tier == Tier.DEFAULT]))
    rows = rows.assign(total_us=rows.update_us + rows.solve_us_p50).drop_duplicates("task")
    table = rows.groupby(["scaling", "solver", "lane", "rung", "unasked"]).agg(
        problems=("problem", "size"), worst_cost_gap=("cost_gap", worst), total_us=("total_us", "median"),
        steps=("periods", "median"), settings=("settings", "first")).reset_index()
    pace = table[(table.solver == ranking.PAPER) & (table.lane == ranking.lane_of_paper(table))]
    table = pd.concat([table.assign(who=np.where(table.solver.isin(OURS), OUR_LINES, OTHER_LINES)),
                       pace.assign(total_us=pace.steps * PERIOD_US, who=ranking.PACE)], ignore_index=True)
    table = table[table.worst_cost_gap.notna() & table.total_us.notna()]
    name = table.solver.map(marked) + np.where(table.lane == Lane.DIRECT, "", " (" + table.lane + ")")
    groups = np.where(table.lane.isin(SEARCHED), "without wrappers", "qpsolvers and cvxpy")
    table = table.assign(name=name.where(table.who != ranking.PACE, ranking.PACE), view=table.scaling + " data, " + groups)
    table = table.sort_values(["scaling", "view", "who", "name", "rung"], ascending=[False, False, True, True, True], ignore_index=True)
    table["front"] = front(table.assign(drawn=np.maximum(table.worst_cost_gap, LEAST_GAP)), "total_us", "drawn") | (table.who == ranking.PACE)
    return table[["view", "scaling", "who", "name", "solver", "lane", "rung", "unasked", "settings", "problems", "worst_cost_gap",
                  "total_us", "front"]]


def _timed(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows at the most exact tier with the time of an answer, infinite where it is not right."""
    table = most_exact(rows[(rows.solver != null_solver.ENTRY.name) & (rows.start == "cold")])
    time = (table.update_us + table.solve_us_p50).where(table.status == Status.OK, np.inf)
    return table.assign(time_us=time.fillna(np.inf))


def performance_profile(rows: pd.DataFrame) -> pd.DataFrame:
    """ρ_s(τ) at its steps, one row a step; those that are never right have none."""
    found = [pd.DataFrame(columns=["view", "name", "solver", "lane", "factor", "share", "front"])]
    for view, part in _timed(rows).groupby("view", sort=False):
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
                found.append(pd.DataFrame({"view": view, "name": name, "solver": lanes.solver[name],
                                           "lane": lanes.lane[name], "factor": factors, "share": shares,
                                           "front": name in near}))
    return together(found)


def sizes(rows: pd.DataFrame) -> pd.DataFrame:
    """Median time of an answer by number of unknowns, where all answers of the size were right; none for one size only."""
    table = _timed(rows)
    table = table[table.groupby("view").d.transform("nunique") > 1]
    found = table.groupby(["view", "name", "solver", "lane", "d"], sort=False).agg(
        problems=("time_us", "size"), time_us=("time_us", "median"), worst=("time_us", "max")).reset_index()
    found = found[np.isfinite(found.worst)].drop(columns="worst")
    fastest = found.groupby(["view", "d"]).time_us.transform("min") if len(found) else found.d
    winners = found[found.time_us == fastest].groupby("view").name.agg(set)
    found["front"] = [name in winners[view] for view, name in zip(found["view"], found["name"], strict=True)]
    return found.reset_index(drop=True)


def time_by_size(rows: pd.DataFrame) -> pd.DataFrame:
    """Of :func:`sizes`, our exact solvers and the fastest others in their fastest lane: view, name, then a column a size.

    Fastest are those with right answers at most sizes, and among them by the geometric mean over the sizes.
    """
    table = sizes(rows)
    if not len(table):
        return table
    wide = table.pivot_table(index=["view", "solver", "name"], columns="d", values="time_us").reset_index()
    times = wide[sorted(set(table.d))]
    wide = wide.assign(ours=wide.solver.isin(EXACT), right=times.notna().sum(axis=1), mean=np.log(times).mean(axis=1))
    wide = wide.sort_values(["view", "ours", "right", "mean"], ascending=[True, False, False, True])
    others = wide[~wide.ours].drop_duplicates(["view", "solver"]).groupby("view").head(OTHERS)
    shown = pd.concat([wide[wide.ours], others]).sort_values(["view", "ours"], ascending=[True, False], kind="stable")
    return shown.drop(columns=["solver", "ours", "right", "mean"]).rename_axis(columns=None).reset_index(drop=True)


def stages(summary: pd.DataFrame) -> pd.DataFrame:
    """Where the time goes, one row a solver lane and stage: medians in µs, and shares of their sum.

    The *wrapper* is what update and solve take more than those of the same library in the lane direct; the rest of
    them is shown as it is there.
    """
    table = most_exact(figures.raced(summary))
    table = table[table.solve_us_p50.notna()]
    lines = table.to_dict("records")
    own = {(line["view"], line["solver"]): (line["update_us"], line["solve_us_p50"])
           for line in lines if line["lane"] == Lane.DIRECT}
    found = []
    for line in lines:
        update, solve, wrapper = line["update_us"], line["solve_us_p50"], 0.0
        bare = own.get((line["view"], IN_LANE_DIRECT.get(line["solver"], line["solver"])))
        if line["lane"] in (Lane.QPSOLVERS, Lane.CVXPY) and bare is not None and (more := update + solve - sum(bare)) > 0.0:
            (update, solve), wrapper = bare, more
        values = (line["setup_us"], update, solve, wrapper)
        who = {name: line[name] for name in ("view", "name", "solver", "lane", "tier")}
        found += [{**who, "stage": stage, "us": us, "share": us / sum(values), "update_and_solve_us": line["total_us"]}
                  for stage, us in zip(STAGES, values, strict=True)]
    return pd.DataFrame(found, columns=["view", "name", "solver", "lane", "tier", "stage", "us", "share",
                                        "update_and_solve_us"])
