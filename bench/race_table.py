"""The table of a race: its columns, each with its type, its heading and how rows become a line of the summary.

A row passes from the worker that measures it (`races.measuring`) through the stream of its part (`part_files`) into
``rows.parquet``, and all results are derived from it (`derived.measurements`).
"""

import math
from typing import Any

import pandas as pd
import pyarrow as pa

from bench.messages.columns import (
    COUNT,
    FLAG,
    NUMBER,
    NUMBERS,
    TEXT,
    TYPICAL,
    Column,
    first_text,
    named,
    schema,
    typical_of_all,
    worst,
)
from bench.messages.task import Row, Tier
from bench.report.words import gap, marked, number, settings_label, share

MISSES = {tier: f"misses_{tier}" for tier in (Tier.LOW, Tier.MID, Tier.HIGH, Tier.EXACT)}
"""Columns of the numbers of judged timed answers that miss a tolerance."""


def status_counts(statuses: pd.Series) -> str:
    """The statuses, or other names, with their numbers, or the only one."""
    counts = statuses.value_counts()
    return str(counts.index[0]) if len(counts) == 1 else ", ".join(f"{count} {name}" for name, count in counts.items())


COLUMNS = (
    Column("solver", TEXT, heading="solver", format=marked),
    Column("lane", TEXT, heading="lane"),
    Column("tier", None, heading="tier"),
    Column("right", None, "sum", "right"),
    Column("judged", COUNT, "min", "judged"),
    Column("miss_rate", None, worst, "misses, at most", share),
    Column("worst_gap", None, worst, "worst gap", gap, of="gap"),
    Column("setup_us", NUMBER, TYPICAL, "setup, µs", number),
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
    Column("solve_us_max", NUMBER, "max", "longest solve, µs", number),
    Column("interleaved_us", None, typical_of_all, "interleaved, µs", number),
    Column("rung", COUNT, "first"),
    Column("problems", None, "size", of="right"),
    Column("median_gap", None, TYPICAL, of="gap"),
    Column("model_error_um", NUMBER, TYPICAL),
    Column("cpu_us", NUMBER, "max"),
    Column("answer_us_spread", None, TYPICAL),
    Column("answer_us", NUMBER, TYPICAL),
    Column("repeatable", FLAG, "all"),
    Column("mutates_input", FLAG, "any"),
    Column("message", TEXT, first_text, "message"),
    Column("digest", TEXT),
    *(Column(name, COUNT) for name in ("draw_seed", "due", "late", "bouts", *MISSES.values())),
    Column("timed_call", COUNT),
    *(Column(name, NUMBERS) for name in ("answer", "timed_answer", "timed_shares", "timed_factors")),
    *named("problem", "d", "setting", "is_default", "timed", "repeat", "host"),
    *named("cost_gap", "violation", "timed_gap", "timed_violation", "timed_stage_excess"),
    *named("primal_residual", "dual_residual", "duality_gap", "weight_error", "stage_excess"),
    *named("optimum_error_um", "noise_um", "solve_us_p99", "samples", "period_us", "reported_us"),
    *named("iterations", "preemptions"),
)
"""One row a measurement. A row is never rewritten: what is measured again, longer or in another way, is a row of its
own. ``timed`` is hot, long, interleaved or scheduled; ``late`` answers of those that were ``due`` missed their
deadline, in ``bouts``. ``answer`` is the first one, and ``timed_answer`` the worst of the ``judged`` timed ones,
drawn with ``draw_seed``, to the data of call ``timed_call``: ``timed_shares`` are the shares of the problem and its
windows in these data, ``timed_factors`` those of q. ``message`` says what failed, or of an answer to judge what its
solver says if that is not found. ``answer_us`` is the median time of an answer, ``cpu_us`` the processor time of a
call, the mean or the median of those in a block of their own, whichever is less, where it is more than half as long
again. A line of the summary is a solver lane at a tier and its setting, over all problems of a set; the columns that
begin with the solver are those of the large table, solver, accuracy and times first, since a screen may cut off the
others."""
KEY = ("problem_set", "problem", "scaling", "solver", "lane", "rung", "start", "timed", "repeat", "host")
"""Columns by which the rows are sorted, and which identify a row."""
ROWS = schema((*named("task", "machine"), *COLUMNS))
"""The columns of the rows with their types."""


def complete(**known: Any) -> Row:
    """A row with the known values; other columns hold "", 0, False or NaN."""
    empty = {TEXT: "", COUNT: 0, FLAG: False}
    return {
        field.name: () if pa.types.is_list(field.type) else empty.get(field.type, math.nan) for field in ROWS
    } | known
