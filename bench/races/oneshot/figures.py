"""Every figure of a report, computed here once and rendered elsewhere.

A *summary* row stands for one solver in one lane, at one tier with the rung that serves it, in one scaling, cold or warm, over all
problems of a set: how many reach the tier, the worst cost gap, medians over the problems of the medians of the times, and the p99 of an
answer over all calls. One that does not reach it on all problems has missed the tier, and ranks below those that do. The last row of
each scaling is the floor, a solver that does nothing.
"""

from __future__ import annotations

import pandas as pd

from bench.races import null_solver
from bench.races.metrics import worst
from bench.races.oneshot import answer_times
from bench.timing.percentiles import percentile
from solvers import Status, Tier
from solvers.registry import OURS

GROUP = ["problem_set", "scaling", "solver", "lane", "tier", "rung", "start"]
FLOOR = "floor"
"""Name and status of the solver that does nothing: its own name, null, would be read from a CSV as a missing value."""


def summary(rows: pd.DataFrame, times: pd.DataFrame) -> pd.DataFrame:
    """One row a solver, lane, tier, rung, start and scaling: right answers first, then by time, the floor last.

    ``settings`` are those of the first problem; tolerances are multiples of a constant of each.
    """
    calls = answer_times.by_task(times)
    rows = rows.assign(right=rows.status == Status.OK, total_us=rows.update_us + rows.solve_us_p50)
    table = rows.groupby(GROUP, dropna=False).agg(
        settings=("settings", "first"), problems=("right", "size"), right=("right", "sum"), status=("status", _statuses),
        worst_cost_gap=("cost_gap", worst), median_cost_gap=("cost_gap", "median"),
        worst_primal_residual=("primal_residual", worst), worst_dual_residual=("dual_residual", worst),
        worst_weight_error=("weight_error", worst), model_error_percent=("model_error_percent", "median"),
        model_error_um=("model_error_um", "median"), setup_us=("setup_us", "median"), update_us=("update_us", "median"),
        solve_us_p50=("solve_us_p50", "median"), answer_us_p99=("task", lambda tasks: percentile(answer_times.pooled(calls, tasks), 0.99).value),
        solve_us_max=("solve_us_max", "max"), solve_us_spread=("solve_us_spread", "median"),
        interleaved_us_p50=("interleaved_us_p50", _known), interleaved_us_p99=("interleaved_us_p99", _known),
        total_us=("total_us", "median"), periods=("periods", "median"),
        repeatable=("repeatable", "all"), mutates_input=("mutates_input", "any"), message=("message", _first_message),
    ).reset_index()
    table = table.assign(all_right=table.right == table.problems, ours=table.solver.isin(OURS), answer_us_p99=table.answer_us_p99.astype(float))
    floor = table.solver == null_solver.ENTRY.name
    table.loc[floor, ["solver", "status"]] = FLOOR
    order = ["problem_set", "scaling", "floor", "all_right", "total_us"]
    return table.assign(floor=floor).sort_values(order, ascending=[True, False, True, False, True],
                                                 ignore_index=True).drop(columns="floor")


def raced(table: pd.DataFrame, start: str = "cold") -> pd.DataFrame:
    """Of a summary, the rows of solvers that start cold, or warm; not the floor, nor rungs for the picture."""
    return at_tiers(table[(table.status != FLOOR) & (table.start == start)])


def at_tiers(table: pd.DataFrame) -> pd.DataFrame:
    """Without the rungs that serve the picture alone."""
    return table[table.tier != Tier.RUNG]


def _known(values: pd.Series) -> float:
    """The median; NaN where any problem has no such figure, so that the quick ones do not stand for all."""
    return float(values.median(skipna=False))


def _statuses(values: pd.Series) -> str:
    counts = values.value_counts()
    return str(counts.index[0]) if len(counts) == 1 else ", ".join(f"{count} {name}" for name, count in counts.items())


def _first_message(values: pd.Series) -> str:
    said = [value for value in values if value]
    return str(said[0]) if said else ""


def failures(rows: pd.DataFrame) -> list[list[str]]:
    """What went wrong, once a solver lane, tier, scaling and status: these, how often, the first problem and its message.

    Breakdowns come first, then answers that are not exact enough. That the upper rungs for the picture fail is in their nature.
    """
    wrong = at_tiers(rows[(rows.message != "") & (rows.solver != null_solver.ENTRY.name)])
    wrong = wrong.assign(late=wrong.status.isin([str(Status.MISSED), str(Status.UNSUPPORTED)]))
    lines = [[*names[1:], str(len(part)), f"{part.problem_set.iloc[0]}/{part.problem.iloc[0]}", part.message.iloc[0]]
             for names, part in wrong.groupby(["late", "solver", "lane", "tier", "scaling", "status"], sort=True)]
    return [[str(cell) for cell in line] for line in lines]
