"""Columns of the table of a one-shot race, from which all results are derived."""

import pandas as pd

from bench.derived.statistics import TYPICAL, first_text, typical_of_all, worst
from bench.messages.columns import COUNT, FLAG, NUMBER, NUMBERS, TEXT, Column, named
from bench.report.words import gap, marked, number, settings_label, share
from bench.store import Run, RunError, Schema


def status_counts(statuses: pd.Series) -> str:
    """The statuses with their numbers, or the only one."""
    counts = statuses.value_counts()
    return str(counts.index[0]) if len(counts) == 1 else ", ".join(f"{count} {name}" for name, count in counts.items())


ONESHOT = Schema(
    "rows.parquet",
    (
        Column("solver", TEXT, heading="solver", format=marked),
        Column("lane", TEXT, heading="lane"),
        Column("tier", None, heading="tier"),
        Column("right", None, "sum", "right"),
        Column("worst_cost_gap", None, worst, "worst cost gap", gap, of="cost_gap"),
        Column("update_us", NUMBER, TYPICAL, "update, µs", number),
        Column("solve_us_p50", NUMBER, TYPICAL, "solve, µs", number),
        Column("answer_us_p99", None, None, "p99 of an answer, µs", number),
        Column("periods", NUMBER, TYPICAL, "periods", number),
        Column("status", TEXT, status_counts, "status"),
        Column("problem_set", TEXT, heading="problem set"),
        Column("scaling", TEXT, heading="scaling"),
        Column("start", TEXT, heading="start"),
        Column("left_out", None, heading="leave-one-out", format=share),
        Column("settings", TEXT, "first", "settings", settings_label),
        Column("optimum", None, heading="|V*| / cost scale"),
        Column("worst_primal_residual", None, worst, "primal residual", gap, of="primal_residual"),
        Column("worst_dual_residual", None, worst, "dual residual", gap, of="dual_residual"),
        Column("worst_weight_error", None, worst, "weight error", gap, of="weight_error"),
        Column("model_error_percent", NUMBER, TYPICAL, "model error, %", number),
        Column("setup_us", NUMBER, TYPICAL, "setup, µs", number),
        Column("solve_us_max", NUMBER, "max", "longest solve, µs", number),
        Column("interleaved_us", None, typical_of_all, "interleaved, µs", number),
        Column("rung", COUNT, "first"),
        Column("problems", None, "size", of="right"),
        Column("median_cost_gap", None, TYPICAL, of="cost_gap"),
        Column("model_error_um", NUMBER, TYPICAL),
        Column("cpu_us", NUMBER, "max"),
        Column("answer_us_spread", None, TYPICAL),
        Column("answer_us", NUMBER, TYPICAL),
        Column("repeatable", FLAG, "all"),
        Column("mutates_input", FLAG, "any"),
        Column("message", TEXT, first_text),
        Column("digest", TEXT),
        Column("machine", TEXT),
        Column("judged", COUNT),
        Column("timed_call", COUNT),
        *(Column(name, NUMBERS) for name in ("answer", "timed_answer", "timed_shares", "timed_factors")),
        *named("problem", "d", "setting", "is_default", "timed", "session", "repeat", "host"),
        *named("cost_gap", "violation", "timed_gap", "timed_violation", "timed_stage_excess"),
        *named("primal_residual", "dual_residual", "duality_gap", "weight_error", "stage_excess"),
        *named("optimum_error_um", "noise_um", "solve_us_p99", "samples", "period_us", "reported_us"),
        *named("iterations", "preemptions"),
    ),
    ("problem_set", "problem", "scaling", "solver", "lane", "rung", "start", "timed", "session", "repeat", "host"),
)
"""One row per measurement. A row is never rewritten: what is measured again, longer or in another way, is a row of its
own. ``timed`` is hot, long or interleaved; ``session`` 0 in the race that made the run. ``answer`` is the first one,
and ``timed_answer`` the worst of the ``judged`` timed ones, to the data of call ``timed_call``: ``timed_shares`` are
the shares of the problem and its windows in these data, ``timed_factors`` those of q. ``answer_us`` is the median time
of an answer, ``cpu_us`` the mean processor time of a call where that is more than half as long again. A line of the
summary is a solver lane at a tier and its setting, over all problems of a set; the columns that begin with the solver
are those of the large table, solver, accuracy and times first, since a screen may cut off the others."""


def rows_of(run: Run) -> pd.DataFrame:
    """The rows of a one-shot or anytime race; RunError for a run of another kind."""
    if run.race not in ("oneshot", "anytime"):
        raise RunError(f"{run.path} is a {run.race} race, and this needs the rows of a one-shot race")
    return run.rows(ONESHOT)
