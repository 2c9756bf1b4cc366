"""Rows of the one-shot race: each holds the accuracy and the times of one measurement, independent of tiers."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.messages.task import Row, Task
from bench.problems.protocol import RaceProblem
from bench.races.metrics import judge
from bench.races.oneshot.blocks import Measurement
from bench.timing.percentiles import percentile


def row_of(problem: RaceProblem, task: Task, measured: Measurement) -> Row:
    """The row of a task.

    ``periods`` is the number of steps of a method that does one step a sample, else NaN. A percentile is NaN if the
    sample is too small for it.
    """
    outcome = measured.outcome
    judgement = replace(judge(problem, task.scaling, outcome), timed_gap=measured.timed_gap)
    if measured.fault is not None:
        judgement = replace(judgement, status=measured.fault[0], message=measured.fault[1])
    solve, update = outcome.solve_ns / 1e3, outcome.update_ns / 1e3
    steps = outcome.settings.get("steps")
    span_um = problem.validation.span_um if problem.validation is not None else np.nan
    middle, tail = percentile(solve, 0.5), percentile(solve, 0.99)
    return {
        **task.columns(outcome.settings),
        "task": replace(task, repeat=0).key,  # the same in all repeats
        **asdict(judgement),
        "model_error_um": judgement.model_error_percent / 100.0 * span_um,
        "optimum_error_um": problem.optimum_error_percent / 100.0 * span_um,
        "noise_um": problem.validation.noise_um if problem.validation is not None else np.nan,
        "setup_us": median(outcome.setup_ns / 1e3),
        "update_us": median(update),
        "solve_us_p50": median(solve),
        "solve_us_p50_low": number(middle.low),
        "solve_us_p50_high": number(middle.high),
        "solve_us_p99": number(tail.value),
        "solve_us_p99_low": number(tail.low),
        "solve_us_p99_high": number(tail.high),
        "solve_us_max": float(solve.max()) if solve.size else np.nan,
        "samples": int(solve.size),
        "interleaved_us_p50": np.nan,
        "interleaved_us_p99": np.nan,
        "periods": float(steps) if steps else np.nan,
        "reported_us": outcome.reported_us,
        "iterations": outcome.iterations,
        "mutates_input": outcome.mutated,
        "repeatable": outcome.repeatable,
        "preemptions": outcome.preemptions,
    }


def answer_us(row: Mapping[str, Any]) -> float:
    """Median time of update and solve."""
    return float(row["update_us"] + row["solve_us_p50"])


def median(values: NDArray[Any]) -> float:
    """Median; NaN of an empty array."""
    return float(np.median(values)) if values.size else np.nan


def number(value: float | None) -> float:
    """NaN for None."""
    return np.nan if value is None else value
