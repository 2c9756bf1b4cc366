"""The large table of a one-shot race.

A row is a solver lane at one tier and its setting, in one scaling, from a cold or warm start, over all problems of a
set: the number of right answers, the worst cost gap, medians over the problems of the median times, and the p99 of an
answer over all calls. A tier that is not reached has no row. The last row of each scaling is the floor, a solver that
does nothing.
"""

import math

import pandas as pd

from bench.derived.measurements import FLOOR as NULL
from bench.derived.measurements import ONESHOT, Measurements
from bench.derived.tiers import LANE
from bench.messages.columns import Column, combined
from bench.messages.task import Status, Tier
from bench.report.words import marked, settings_label
from bench.timing.percentiles import percentile
from solvers.registry import OURS

GROUP = ["problem_set", "scaling", "solver", "lane", "tier", "setting", "start"]
FLOOR = "floor"
"""Name and status of the solver that does nothing; its own name, null, would read as a missing value in a CSV."""
WRONG = (
    Column("solver", heading="solver", format=marked),
    *(Column(name, heading=name) for name in ("lane", "scaling", "status")),
    Column("times", None, "size", "times", of="task"),
    Column("settings", None, "first", "settings", settings_label),
    Column("such_as", None, "first", "such as"),
    Column("message", None, "first", "message"),
)


def summary(measurements: Measurements) -> pd.DataFrame:
    """One row per GROUP: those with all answers right first, then by time, the floor last.

    ``settings`` are those of the first problem, since tolerances are multiples of a constant of the problem;
    ``left_out`` counts all sets together.
    """
    nothing = measurements.rows[measurements.rows.solver == NULL].assign(tier=str(Tier.DEFAULT), right=False)
    rows = pd.concat([measurements.tiers, nothing], ignore_index=True)
    tasks = rows.groupby(GROUP, dropna=False).task
    table = combined(rows, ONESHOT.columns, GROUP).assign(
        answer_us_p99=[percentile(measurements.pooled(of_line), 0.99).value or math.nan for _, of_line in tasks]
    )
    table = table.assign(
        all_right=table.right == table.problems,
        ours=table.solver.isin(OURS),
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


def failures(measurements: Measurements) -> pd.DataFrame:
    """WRONG, one row per solver lane, scaling and status: the number of failures, and the first. Rows that were not run
    are no failures."""
    wrong = measurements.field[(measurements.field.message != "") & (measurements.field.status != Status.NOT_RUN)]
    return combined(
        wrong.assign(such_as=wrong.problem_set + "/" + wrong.problem), WRONG, ["solver", "lane", "scaling", "status"]
    )
