"""Rows of the one-shot race: each holds the accuracy and the times of one measurement, independent of tiers."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.derived.table import ONESHOT
from bench.messages.task import Row, Task
from bench.problems.fresh import FreshData
from bench.problems.protocol import RaceProblem
from bench.races.metrics import judge, judge_timed
from bench.races.oneshot.blocks import Measurement
from bench.timing import machine
from bench.timing.clock import answers_us
from bench.timing.percentiles import percentile


def row_of(problem: RaceProblem, task: Task, measured: Measurement, fresh: FreshData | None, few: int) -> Row:
    """The row of a task; ``few`` of its timed answers are judged, on ``fresh`` data.

    A percentile is NaN if the sample is too small for it.
    """
    outcome, validation = measured.outcome, problem.validation
    judgement = judge(problem, task.scaling, outcome)
    us = answers_us(outcome.update_ns, outcome.solve_ns, measured.cpu_us)
    solve, steps, x = outcome.solve_ns / 1e3, outcome.settings.get("steps"), outcome.x
    span_um = math.nan if validation is None else validation.span_um
    return ONESHOT.row(
        **{
            **task.columns(outcome.settings),
            "task": task.subject,
            "digest": problem.digest,
            "machine": machine.here(),
            "period_us": problem.period_us,
            **judgement,
            "timed_call": -1,
            **(judge_timed(problem, fresh, measured.answers, few) if fresh is not None else {}),
            "answer": () if x is None or x.ndim != 1 else tuple(map(float, x)),
            "model_error_um": judgement.get("model_error_percent", math.nan) / 100.0 * span_um,
            "optimum_error_um": problem.optimum_error_percent / 100.0 * span_um,
            "noise_um": math.nan if validation is None else validation.noise_um,
            "setup_us": median(outcome.setup_ns / 1e3),
            "update_us": median(outcome.update_ns / 1e3),
            "solve_us_p50": median(solve),
            "solve_us_p99": percentile(solve, 0.99).value or math.nan,
            "solve_us_max": float(solve.max()) if solve.size else math.nan,
            "answer_us": median(us),
            "cpu_us": measured.cpu_us,
            "samples": int(solve.size),
            "periods": float(steps) if steps else median(us) / problem.period_us,
            "reported_us": outcome.reported_us,
            "iterations": outcome.iterations,
            "mutates_input": outcome.mutated,
            "repeatable": outcome.repeatable,
            "preemptions": outcome.preemptions,
        }
    )


def median(values: NDArray[Any]) -> float:
    """Median; NaN of an empty array."""
    return float(np.median(values)) if values.size else math.nan
