"""Rows of the one-shot race: from one task's outcome, and over the repeats of a task in several fresh processes.

Over repeats a row keeps the medians of the times, the largest maximum, the sum of the samples, and the spread

    (max p50 − min p50) / median p50

of the solve, which is what a fresh process changes. What is said of the answer is that of the first repeat that is not ok,
so that nothing which goes wrong now and then is lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.passed.outcome import Outcome
from bench.passed.row import Row, for_tiers, who
from bench.passed.task import Task
from bench.problems.protocol import RaceProblem
from bench.races.metrics import judge
from bench.store import Schema
from bench.timing.percentiles import percentile
from bench.timing.schedule import PERIOD_US
from solvers import Status
from solvers.arrays import Nanoseconds

NAN = float("nan")


MEDIANS = ("setup_us", "update_us", "solve_us_p50", "solve_us_p50_low", "solve_us_p50_high", "solve_us_p99",
           "solve_us_p99_low", "solve_us_p99_high", "interleaved_us_p50", "interleaved_us_p99", "periods", "reported_us")
SUMS = ("samples", "preemptions")


def rows_of(problem: RaceProblem, task: Task, outcome: Outcome, timed_gap: float = NAN, fault: tuple[Status, str] | None = None) -> list[Row]:
    """The rows of a task, one for each tier that it serves: who, what, how right and how fast.

    ``timed_gap`` is that of the answers that were timed, and ``fault`` what is wrong with the way in which they came.

    ``periods`` is what the answer takes in sampling periods: the steps of a method that does one step a sample, else
    the median of update and solve over 125 µs. Percentiles are NaN where the sample cannot support them.
    """
    verdict = replace(judge(problem, task.scaling, outcome), timed_gap=timed_gap)
    if fault is not None and not outcome.failure:
        verdict = replace(verdict, status=fault[0], message=fault[1])
    solve, update = outcome.solve_ns / 1e3, outcome.update_ns / 1e3
    steps = outcome.asked.get("steps")
    span_um = problem.validation.span_um if problem.validation is not None else NAN
    middle, tail = percentile(solve, 0.5), percentile(solve, 0.99)
    row = {
        **who(task, problem.d, outcome.asked), "task": key_of_all_repeats(task), "start": task.start, **asdict(verdict),
        "model_error_um": verdict.model_error_percent / 100.0 * span_um,
        "optimum_error_um": problem.optimum_error_percent / 100.0 * span_um,
        "noise_um": problem.validation.noise_um if problem.validation is not None else NAN,
        "setup_us": median(outcome.setup_ns / 1e3), "update_us": median(update), "solve_us_p50": median(solve),
        "solve_us_p50_low": number(middle.low), "solve_us_p50_high": number(middle.high),
        "solve_us_p99": number(tail.value), "solve_us_p99_low": number(tail.low), "solve_us_p99_high": number(tail.high),
        "solve_us_max": float(solve.max()) if solve.size else NAN, "samples": int(solve.size),
        "interleaved_us_p50": NAN, "interleaved_us_p99": NAN,
        "periods": float(steps) if steps else (median(update) + median(solve)) / PERIOD_US,
        "reported_us": outcome.reported_us, "iterations": outcome.iterations, "mutates_input": outcome.mutated,
        "repeatable": outcome.repeatable, "preemptions": outcome.preemptions}
    at = {str(tier): verdict.at(tier) for tier in task.tiers}
    return [{**each, "status": str(at[each["tier"]].status), "message": at[each["tier"]].message} for each in for_tiers(task, [row])]


def times_of(outcome: Outcome) -> dict[str, Nanoseconds]:
    """Raw nanoseconds by what was timed."""
    return {"setup": outcome.setup_ns, "update": outcome.update_ns, "solve": outcome.solve_ns}


def with_turns(row: Mapping[str, Any], solve_ns: Nanoseconds) -> Row:
    """The row of a task with the figures of its turns."""
    solve = solve_ns / 1e3
    return {**row, "interleaved_us_p50": median(solve), "interleaved_us_p99": number(percentile(solve, 0.99).value)}


def key_of_all_repeats(task: Task) -> str:
    """The key under which all repeats of a task are one row."""
    return replace(task, repeat=0).key


def over_repeats(rows: Iterable[Mapping[str, Any]]) -> list[Row]:
    """One row for all repeats of each task and tier."""
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["task"], row["tier"]), []).append(row)
    return [_merged(sorted(group, key=lambda row: row["repeat"])) for group in groups.values()]


def _merged(group: Sequence[Mapping[str, Any]]) -> Row:
    first = next((row for row in group if row["status"] != Status.OK), group[0])
    p50 = np.array([row["solve_us_p50"] for row in group], dtype=np.float64)
    p50 = p50[np.isfinite(p50)]
    return {
        **first, **{name: middle(row[name] for row in group) for name in MEDIANS},
        **{name: sum(row[name] for row in group) for name in SUMS},
        "solve_us_max": max((row["solve_us_max"] for row in group if np.isfinite(row["solve_us_max"])), default=NAN),
        "mutates_input": any(row["mutates_input"] for row in group), "repeatable": all(row["repeatable"] for row in group),
        "repeats": len(group), "solve_us_spread": float(np.ptp(p50) / np.median(p50)) if p50.size > 1 else NAN}


def middle(values: Iterable[float]) -> float:
    """Median of what is a number.

    Examples
    --------
    >>> middle([1.0, float("nan"), 3.0])
    2.0
    """
    return median(np.array([value for value in values if np.isfinite(value)]))


def median(values: NDArray[Any]) -> float:
    """Median, NaN of nothing."""
    return float(np.median(values)) if values.size else NAN


def number(value: float | None) -> float:
    """NaN for None."""
    return NAN if value is None else value


ONESHOT = Schema("rows.parquet", (
    "problem_set", "problem", "d", "solver", "lane", "tier", "rung", "scaling", "start", "settings", "status", "message",
    "cost_gap", "violation", "timed_gap", "primal_residual", "dual_residual", "duality_gap", "weight_error",
    "model_error_percent", "stage_excess", "model_error_um", "optimum_error_um", "noise_um",
    "setup_us", "update_us", "solve_us_p50", "solve_us_p50_low",
    "solve_us_p50_high", "solve_us_p99", "solve_us_p99_low", "solve_us_p99_high", "solve_us_max", "samples",
    "repeats", "solve_us_spread", "interleaved_us_p50", "interleaved_us_p99", "periods", "reported_us",
    "iterations", "mutates_input", "repeatable", "preemptions"),
    ("problem_set", "problem", "scaling", "solver", "lane", "rung", "tier", "start"), over_repeats)
"""One row a task and tier, over its repeats: what serves several tiers was measured once, and so has the same figures in all."""
