"""Rows of the one-shot race, each of one measurement: who, what, how right and how fast. None knows of a tier."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.messages.task import Outcome, Row, Task
from bench.problems.protocol import RaceProblem
from bench.races.metrics import judge
from bench.timing.percentiles import percentile
from bench.timing.schedule import PERIOD_US
from solvers import Status
from solvers.arrays import Nanoseconds

ENDS = (Status.CRASHED, Status.TIMED_OUT, Status.OUT_OF_MEMORY)
LONGEST_US = 1e5
"""A ladder ends on a problem where an answer takes longer."""


def row_of(
    problem: RaceProblem,
    task: Task,
    outcome: Outcome,
    timed_gap: float = np.nan,
    fault: tuple[Status, str] | None = None,
) -> Row:
    """The row of a task.

    ``timed_gap`` is that of the answers that were timed, and ``fault`` what is wrong with the way in which they came.

    ``periods`` is what the answer takes in sampling periods: the steps of a method that does one step a sample, else
    the median of update and solve over 125 µs. Percentiles are NaN where the sample cannot support them.
    """
    found = replace(judge(problem, task.scaling, outcome), timed_gap=timed_gap)
    if fault is not None and not outcome.failure:
        found = replace(found, status=fault[0], message=fault[1])
    solve, update = outcome.solve_ns / 1e3, outcome.update_ns / 1e3
    steps = outcome.asked.get("steps")
    span_um = problem.validation.span_um if problem.validation is not None else np.nan
    middle, tail = percentile(solve, 0.5), percentile(solve, 0.99)
    return {
        **task.columns(outcome.asked),
        "task": key_of_all_repeats(task),
        **asdict(found),
        "model_error_um": found.model_error_percent / 100.0 * span_um,
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
        "periods": float(steps) if steps else (median(update) + median(solve)) / PERIOD_US,
        "reported_us": outcome.reported_us,
        "iterations": outcome.iterations,
        "mutates_input": outcome.mutated,
        "repeatable": outcome.repeatable,
        "preemptions": outcome.preemptions,
    }


def not_run(problem: RaceProblem, task: Task, after: Row) -> Row:
    """The row of a setting that is tighter than one with which the ladder ended."""
    why = "took longer than 0.1 s" if after["status"] not in ENDS else f"ended with {after['status']}"
    return row_of(problem, task, Outcome(str(Status.NOT_RUN), f"a looser setting {why} on this problem"))


def ends_ladder(row: Row) -> bool:
    """Whether tighter settings are not tried on this problem."""
    return row["status"] in (*ENDS, Status.NOT_RUN) or row["update_us"] + row["solve_us_p50"] > LONGEST_US


def times_of(outcome: Outcome) -> dict[str, Nanoseconds]:
    """Raw nanoseconds by what was timed."""
    return {"setup": outcome.setup_ns, "update": outcome.update_ns, "solve": outcome.solve_ns}


def with_turns(row: Mapping[str, Any], solve_ns: Nanoseconds) -> Row:
    """The row of a task with the figures of its turns."""
    solve = solve_ns / 1e3
    return {**row, "interleaved_us_p50": median(solve), "interleaved_us_p99": number(percentile(solve, 0.99).value)}


def key_of_all_repeats(task: Task) -> str:
    """The key that all repeats of a task share."""
    return replace(task, repeat=0).key


def median(values: NDArray[Any]) -> float:
    """Median, NaN of nothing."""
    return float(np.median(values)) if values.size else np.nan


def number(value: float | None) -> float:
    """NaN for None."""
    return np.nan if value is None else value
