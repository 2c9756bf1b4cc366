"""Columns of the table of a one-shot race, from which all results are derived."""

import pyarrow as pa

from bench.messages import columns
from bench.store import Schema

NUMBERS = pa.list_(pa.float64())
ONESHOT = Schema(
    "rows.parquet",
    (
        "problem_set",
        "problem",
        "digest",
        "d",
        "scaling",
        "start",
        "solver",
        "lane",
        "setting",
        "rung",
        "is_default",
        "timed",
        "session",
        "repeat",
        "host",
        "machine",
        "settings",
        "status",
        "message",
        "cost_gap",
        "violation",
        "timed_gap",
        "timed_violation",
        "timed_stage_excess",
        "judged",
        "primal_residual",
        "dual_residual",
        "duality_gap",
        "weight_error",
        "model_error_percent",
        "stage_excess",
        "model_error_um",
        "optimum_error_um",
        "noise_um",
        "setup_us",
        "update_us",
        "solve_us_p50",
        "solve_us_p99",
        "solve_us_max",
        "answer_us",
        "cpu_us",
        "samples",
        "period_us",
        "periods",
        "reported_us",
        "iterations",
        "mutates_input",
        "repeatable",
        "preemptions",
        "answer",
        "timed_call",
        "timed_answer",
        "timed_shares",
        "timed_factors",
    ),
    ("problem_set", "problem", "scaling", "solver", "lane", "rung", "start", "timed", "session", "repeat", "host"),
    dict.fromkeys(("digest", "machine"), columns.TEXT)
    | dict.fromkeys(("judged", "timed_call"), columns.COUNT)
    | dict.fromkeys(("answer", "timed_answer", "timed_shares", "timed_factors"), NUMBERS),
)
"""One row per measurement. A row is never rewritten: what is measured again, longer or in another way, is a row of its
own. ``timed`` is hot, long or interleaved; ``session`` 0 in the race that made the run. ``answer`` is the first one,
and ``timed_answer`` the worst of the ``judged`` timed ones, to the data of call ``timed_call``: ``timed_shares`` are
the shares of the problem and its windows in these data, ``timed_factors`` those of q. ``answer_us`` is the median time
of an answer, ``cpu_us`` the mean processor time of a call where that is more than half as long again."""
