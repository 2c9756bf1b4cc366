"""What the plots of a one-shot race show, computed here once as tables; `charts`, `plots` and the CSV beside them render it.

Each solver lane stands for itself at the most exact tier that it raced, started cold. A *view* is one problem set in one
scaling. The time of an answer is the median of update plus the median of solve.

The performance profile of Dolan and Moré over the problems p of a view, with t_p,s infinite where s was not right:

    ρ_s(τ) = share of the p with t_p,s ≤ τ · min over all solvers of t_p

Source: E. D. Dolan and J. J. Moré, Mathematical Programming 91 (2002) 201 to 213.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from bench.races import null_solver
from bench.races.calibration import IN_LANE_DIRECT
from bench.races.oneshot import figures
from bench.report.charts import LEAST_GAP, NAMED, together
from bench.timing.schedule import PERIOD_US
from solvers import Lane, Status, Tier

MOST_EXACT = [str(tier) for tier in (Tier.HIGH, Tier.EXACT, Tier.MID, Tier.LOW, Tier.DEFAULT, Tier.STAGE)]
PAPERS_PACE = "one step a period"
FULL_SOLVE = "full solve"
OURS, OTHERS = ("box_active_set", "recursive_active_set"), 5
"""Whose time by size stands in the report beside that of how many others."""
STAGES = ("set-up", "update", "solve", "wrapper")


def named(table: pd.DataFrame) -> pd.DataFrame:
    """The table with its views and with names of solver lanes."""
    return table.assign(view=table.problem_set + ", " + table.scaling + " data",
                        name=table.solver + " (" + table.lane + ")", stepping=table.settings.str.contains('"steps"'))


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


def accuracy(rows: pd.DataFrame) -> pd.DataFrame:
    """Worst cost gap against the time of an answer, one row a solver lane; the paper's pace one row a number of steps."""
    table = figures.raced(figures.summary(rows))
    solved = most_exact(table).assign(pace=FULL_SOLVE)
    stepping = named(table)
    stepping = stepping[stepping.stepping & (stepping.lane == str(Lane.KERNEL))]
    stepping = stepping.assign(pace=PAPERS_PACE, total_us=stepping.periods * PERIOD_US).sort_values(["solver", "periods"])
    found = pd.concat([solved, stepping], ignore_index=True)
    found = found[found.worst_cost_gap.notna() & found.total_us.notna()]
    drawn = found[found.pace == FULL_SOLVE].assign(drawn=np.maximum(found.worst_cost_gap, LEAST_GAP))
    found["front"] = front(drawn, "total_us", "drawn").reindex(found.index, fill_value=False)
    return found[["view", "problem_set", "scaling", "name", "solver", "lane", "tier", "settings", "pace", "problems", "right",
                  "worst_cost_gap", "total_us", "front"]].reset_index(drop=True)


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
    wide = wide.assign(ours=wide.solver.isin(OURS), right=times.notna().sum(axis=1), mean=np.log(times).mean(axis=1))
    wide = wide.sort_values(["view", "ours", "right", "mean"], ascending=[True, False, False, True])
    others = wide[~wide.ours].drop_duplicates(["view", "solver"]).groupby("view").head(OTHERS)
    shown = pd.concat([wide[wide.ours], others]).sort_values(["view", "ours"], ascending=[True, False], kind="stable")
    return shown.drop(columns=["solver", "ours", "right", "mean"]).rename_axis(columns=None).reset_index(drop=True)


def stages(rows: pd.DataFrame) -> pd.DataFrame:
    """Where the time goes, one row a solver lane and stage: medians in µs, and shares of their sum.

    The *wrapper* is what update and solve take more than those of the same library in the lane direct; the rest of
    them is shown as it is there.
    """
    table = most_exact(figures.raced(figures.summary(rows)))
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
