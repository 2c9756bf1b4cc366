"""The large table of a race.

A row is a solver lane at one tier and its setting, in one scaling, from a cold or warm start, over all problems of a
set: the number of right answers, the worst gap or violation, medians over the problems of the median times, and the
p99 of an answer over all calls. A tier that is not reached has no row. The last row of each scaling is the floor, a
solver that does nothing.

Beside it stand what went wrong, and where each solver lane misses a cost gap of 1e-9, problem by problem. There a lane
is judged at its setting for 1e-9, or at the one that is right on most problems, from a cold start in the first scaling.
Gap and violation are those of the first answer, ``timed_gap`` is the largest gap or violation of the answers that were
judged among the timed ones.
"""

import math
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pandas as pd

from bench.derived.measurements import NULL_SOLVER, Measurements, at_tiers, merged
from bench.derived.tiers import LANE, distance
from bench.messages.columns import Column, combined
from bench.messages.task import Status, Tier
from bench.problem_files.miss import Miss
from bench.problems.fresh import mixture
from bench.race_table import COLUMNS
from bench.report.words import marked, settings_label
from bench.store import Run, RunError
from bench.timing.percentiles import percentile
from solvers.certificate import NotCertified
from solvers.registry import OURS

GROUP = ["problem_set", "scaling", "solver", "lane", "tier", "setting", "start"]
NOTHING = "floor"
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
    nothing = measurements.rows[measurements.rows.solver == NULL_SOLVER].assign(
        tier=str(Tier.DEFAULT), right=False, gap=math.nan
    )
    rows = pd.concat([measurements.rows_at_tiers, nothing], ignore_index=True)
    tasks = rows.groupby(GROUP, dropna=False).task
    table = combined(rows, COLUMNS, GROUP).assign(
        answer_us_p99=[percentile(measurements.pooled(of_line), 0.99) for _, of_line in tasks]
    )
    table = table.assign(
        all_right=table.right == table.problems,
        ours=table.solver.isin(OURS),
    )
    table = table.merge(measurements.settings[[*LANE, "tier", "margin", "left_out"]], on=[*LANE, "tier"], how="left")
    floor = table.solver == NULL_SOLVER
    table.loc[floor, ["solver", "status"]] = NOTHING
    order = ["problem_set", "scaling", "floor", "all_right", "answer_us"]
    return (
        table.assign(floor=floor)
        .sort_values(order, ascending=[True, False, True, False, True], ignore_index=True)
        .drop(columns="floor")
    )


def failures(rows: pd.DataFrame) -> pd.DataFrame:
    """WRONG, one row per solver lane, scaling and status: the number of failures, and the first. Rows that were not run
    are no failures, and timed answers that are not finite are."""
    lost = (rows.status == Status.ANSWERED) & np.isinf(rows.timed_gap)
    rows = rows.assign(
        such_as=rows.problem_set + "/" + rows.problem,
        status=rows.status.mask(lost, str(Status.MISSED)),
        message=rows.message.mask(lost, "a timed answer is not finite"),
    )
    failed = (rows.message != "") & ~rows.status.isin([Status.ANSWERED, Status.NOT_RUN])
    return combined(rows[failed], WRONG, ["solver", "lane", "scaling", "status"])


def misses(measurements: Measurements, hopeless: bool = False) -> pd.DataFrame:
    """One row for each solver lane and problem that it misses on any host: the user's own lanes first, then those with
    the fewest misses.

    Another lane that is right on no problem is omitted unless ``hopeless`` is True: its problems do not differ.
    Settings are {} where a solver crashed.
    """
    judged = at_tiers(measurements.first_screen(merged(measurements.all_rows)), measurements.settings, "furthest")
    judged = judged[judged.tier == Tier.HIGH].astype({"right": bool})
    missed = judged.assign(count=~judged.right, some=judged.right, others=~measurements.is_own(judged))
    counts = missed.groupby(["solver", "lane"])[["count", "some"]].transform("sum")
    missed = missed.assign(**counts)[~judged.right & (hopeless | ~missed.others | (counts.some > 0))]
    return missed.fillna({"settings": "{}"}).sort_values(
        ["others", "count", "solver", "lane", "problem"], ignore_index=True
    )


def worst_misses(run: Run, measurements: Measurements, most: int) -> Iterator[tuple[str, Miss]]:
    """The worst missed answers of at most ``most`` solver lanes, in the order of :func:`misses`, with names for
    their files; the answer of each is the first one, or the worst timed one that was judged if that is worse."""
    worst = misses(measurements, hopeless=True).sort_values("gap", ascending=False)
    for line in worst.drop_duplicates(["solver", "lane"]).sort_index().head(most).to_dict("records"):
        rows = measurements.all_rows[measurements.all_rows.task == line["task"]]
        *_, row = rows.assign(distance=distance(rows)).sort_values("distance").to_dict("records")
        with suppress(RunError, NotCertified):  # a miss without its problem is still in the table
            form = first = run.problem(row["problem_set"], row["problem"]).forms[row["scaling"]]
            x = row["answer"]
            if row["judged"] and row["timed_gap"] > max(row["cost_gap"], row["violation"]):
                form, x = mixture(first, row["timed_shares"], row["timed_factors"]), row["timed_answer"]
            yield (
                f"{row['solver']}-{row['lane']}-{row['problem_set']}--{row['problem']}.npz",
                Miss(
                    row["solver"],
                    row["lane"],
                    row["settings"],
                    first.qp,
                    form.qp,
                    x,
                    np.array(form.certificate.x),
                    form.yardstick,
                ),
            )
