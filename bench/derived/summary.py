"""The large table of a one-shot race.

A row is a solver lane at one tier and its setting, in one scaling, from a cold or warm start, over all problems of a
set: the number of right answers, the worst cost gap, medians over the problems of the median times, and the p99 of an
answer over all calls. A tier that is not reached has no row. The last row of each scaling is the floor, a solver that
does nothing.
"""

import pandas as pd

from bench.derived.accuracy import worst
from bench.derived.measurements import FLOOR as NULL
from bench.derived.measurements import Measurements
from bench.derived.tier_settings import LANE
from bench.messages.verdict import Status, Tier
from bench.report.words import settings_label
from bench.timing.percentiles import percentile
from solvers.registry import OURS

GROUP = ["problem_set", "scaling", "solver", "lane", "tier", "setting", "start"]
FLOOR = "floor"
"""Name and status of the solver that does nothing; its own name, null, would read as a missing value in a CSV."""


def summary(measurements: Measurements) -> pd.DataFrame:
    """One row per GROUP: those with all answers right first, then by time, the floor last.

    ``settings`` are those of the first problem, since tolerances are multiples of a constant of the problem;
    ``left_out`` counts all sets together.
    """
    nothing = measurements.rows[measurements.rows.solver == NULL].assign(tier=str(Tier.DEFAULT), right=False)
    rows = pd.concat([measurements.tiers, nothing], ignore_index=True)
    table = (
        rows.groupby(GROUP, dropna=False)
        .agg(
            settings=("settings", "first"),
            rung=("rung", "first"),
            problems=("right", "size"),
            right=("right", "sum"),
            status=("status", _statuses),
            worst_cost_gap=("cost_gap", worst),
            median_cost_gap=("cost_gap", "median"),
            worst_primal_residual=("primal_residual", worst),
            worst_dual_residual=("dual_residual", worst),
            worst_weight_error=("weight_error", worst),
            model_error_percent=("model_error_percent", "median"),
            model_error_um=("model_error_um", "median"),
            setup_us=("setup_us", "median"),
            update_us=("update_us", "median"),
            solve_us_p50=("solve_us_p50", "median"),
            cpu_us=("cpu_us", "max"),
            answer_us_p99=("task", lambda tasks: percentile(measurements.pooled(tasks), 0.99).value),
            solve_us_max=("solve_us_max", "max"),
            answer_us_spread=("answer_us_spread", "median"),
            interleaved_us=("interleaved_us", _known),
            answer_us=("answer_us", "median"),
            periods=("periods", "median"),
            repeatable=("repeatable", "all"),
            mutates_input=("mutates_input", "any"),
            message=("message", _first_message),
        )
        .reset_index()
    )
    table = table.assign(
        all_right=table.right == table.problems,
        ours=table.solver.isin(OURS),
        answer_us_p99=table.answer_us_p99.astype(float),
    )
    table = table.merge(measurements.settings[[*LANE, "tier", "margin", "left_out"]], on=[*LANE, "tier"], how="left")
    floor = table.solver == NULL
    table.loc[floor, ["solver", "status"]] = FLOOR
    order = ["problem_set", "scaling", "floor", "all_right", "answer_us"]
    return (
        table.assign(floor=floor)
        .sort_values(order, ascending=[True, False, True, False, True], ignore_index=True)
        .drop(columns="floor")
    )


def raced(table: pd.DataFrame, start: str = "cold") -> pd.DataFrame:
    """The rows of a summary with this start, without the floor."""
    return table[(table.status != FLOOR) & (table.start == start)]


def _known(values: pd.Series) -> float:
    """The median; NaN if the time of any problem is missing, so that the fast problems do not stand for all."""
    return float(values.median(skipna=False))


def _statuses(values: pd.Series) -> str:
    counts = values.value_counts()
    return str(counts.index[0]) if len(counts) == 1 else ", ".join(f"{count} {name}" for name, count in counts.items())


def _first_message(values: pd.Series) -> str:
    return next((str(value) for value in values if value), "")


def failures(measurements: Measurements) -> list[list[str]]:
    """Failures, one row per solver lane, scaling and status: these, their number, and setting, problem and message of
    the first.

    Rows that were not run are no failures.
    """
    wrong = measurements.field[(measurements.field.message != "") & (measurements.field.status != Status.NOT_RUN)]
    return [
        [
            str(cell)
            for cell in (
                *names,
                len(part),
                settings_label(part.settings.iloc[0]),
                f"{part.problem_set.iloc[0]}/{part.problem.iloc[0]}",
                part.message.iloc[0],
            )
        ]
        for names, part in wrong.groupby(["solver", "lane", "scaling", "status"], sort=True)
    ]
