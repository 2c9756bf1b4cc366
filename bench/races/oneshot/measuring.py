"""Times one task block by block, with fresh data and with a clock of the parent beside the child's.

The parent knows the processor time of the child's process, and that of the null solver for the same blocks. Their
difference is what the calls cost, whatever the child reports and wherever in a block it does its work, and the time of
an answer counts as no less than two thirds of its mean. Messages cost some hundreds of microseconds a block, which
differ between two processes, so that less than UNSEEN_NS remains unseen.

A row holds the accuracy and the times of one measurement, independent of tiers.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.derived.measurements import ONESHOT
from bench.messages.task import NO_SETTING, Outcome, Row, Task
from bench.problem_files.program import fields_of
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.processes.solver_child import SolverChild
from bench.races.metrics import judge, judge_timed
from bench.races.oneshot.worker import BlockOutcome, Further, OneShot, TimedSolver
from bench.timing.clock import LEAST_SHARE, LONG_NS, Effort, answers_us
from bench.timing.percentiles import percentile
from solvers.arrays import Matrix

UNSEEN_NS = 250_000
"""Processor time of a block by which two processes may differ that do the same."""
TRIALS = 3
"""Number of blocks of the null solver, of which the longest counts."""


@dataclass
class Measurement:
    """The outcome of a task with its times, and its timed answers."""

    outcome: Outcome
    answers: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    cpu_us: float = math.nan
    """Mean processor time of a call, less the null solver's; NaN if LEAST_SHARE of it is below the median time of a
    call."""


def set_up(child: SolverChild, task: Task, form: CertifiedForm) -> Outcome:
    """Set up the solver of a task, which then waits for blocks; the outcome has its first answer. The certificate and
    the other windows stay here."""
    start = form.starts.get(task.start)
    return child.ask(OneShot(task, fields_of(form.qp), start, form.unit, child.entry.times_itself))


def run_block(child: SolverChild, task: Task, P: Matrix, q: Matrix, most_ns: float = math.inf) -> BlockOutcome:
    """Time a block. No call begins after ``most_ns``. It may be a failure; if the process ended, so did the solver that
    was ready."""
    cpu_ns = child.cpu_ns()
    block = child.ask(Further(task.key, TimedSolver.block, (P, q, most_ns)))
    if isinstance(block, BlockOutcome):
        n = len(block.answers) if most_ns < math.inf else len(q)
        times = (block.update_ns, block.solve_ns)
        if 0 < n <= len(q) and block.answers.shape == (n, q.shape[1]) and all(ns.shape == (n,) for ns in times):
            block.cpu_ns = child.cpu_ns() - cpu_ns
            return block
    return BlockOutcome(
        block.failure or "tampered", block.message or "its process sent an answer that was not requested"
    )


def timed(
    child: SolverChild, idle: SolverChild, task: Task, form: CertifiedForm, fresh: FreshData, effort: Effort
) -> Measurement:
    """Time a task; ``idle`` is the process of the null solver."""
    outcome = set_up(child, task, form)
    if outcome.failure:
        return Measurement(outcome)
    blocks: list[BlockOutcome] = []
    size, done, spent_ns = 1, 0, 0
    while effort.goes_on(done, spent_ns):
        n = min(size, fresh.calls_at_once, effort.most - done)
        most_ns = max(effort.budget_s * 1e9, LONG_NS if done < effort.fewest else 0.0) - spent_ns
        block = run_block(child, task, *fresh.block(done, done + n), most_ns=most_ns)
        if block.failure:
            return Measurement(block)
        blocks.append(block)
        done, spent_ns = done + len(block.answers), spent_ns + int((block.update_ns + block.solve_ns).sum())
        call_ns = max(spent_ns / done, 1.0)
        size = max(effort.fewest - done, math.ceil((effort.budget_s * 1e9 - spent_ns) / call_ns), 1)
    end = child.ask(Further(task.key, TimedSolver.end, (effort.budget_s,)))
    if end.failure:
        return Measurement(end)
    if end.forbidden_actions:
        return Measurement(Outcome("tampered", "; ".join(end.forbidden_actions)))
    outcome = replace(outcome, setup_ns=end.setup_ns, repeatable=end.repeatable, mutated=end.mutated)
    return measurement(outcome, blocks, lambda: _idle_ns(idle, task, form, fresh, blocks))


def measurement(outcome: Outcome, blocks: Sequence[BlockOutcome], idle_ns: Callable[[], float]) -> Measurement:
    """The outcome of a task with the calls of its blocks; ``idle_ns`` is the null solver's processor time for them."""
    update_ns, solve_ns = (
        np.concatenate([getattr(block, name) for block in blocks]) for name in ("update_ns", "solve_ns")
    )
    outcome = replace(
        outcome, update_ns=update_ns, solve_ns=solve_ns, preemptions=sum(block.preemptions for block in blocks)
    )
    used_ns, cpu_us = float(sum(block.cpu_ns - UNSEEN_NS for block in blocks)), math.nan
    least_ns = 1e3 * solve_ns.size * float(np.median(answers_us(update_ns, solve_ns))) / LEAST_SHARE
    if used_ns > least_ns and (used_ns := used_ns - idle_ns()) > least_ns:
        cpu_us = used_ns / solve_ns.size / 1e3
    return Measurement(outcome, np.concatenate([block.answers for block in blocks]), cpu_us)


def _idle_ns(
    idle: SolverChild, task: Task, form: CertifiedForm, fresh: FreshData, blocks: Sequence[BlockOutcome]
) -> float:
    """Processor time of the null solver for the data of consecutive blocks; infinite if it fails, and for itself."""
    if task.solver == idle.entry.name:
        return math.inf
    null_task = replace(task, solver=idle.entry.name, lane=idle.entry.lane, setting=NO_SETTING)
    ends = np.cumsum([len(block.answers) for block in blocks])
    set_up(idle, null_task, form)
    again = [
        [run_block(idle, null_task, *fresh.block(first, last)) for _ in range(TRIALS)]
        for first, last in pairwise([0, *ends])
    ]
    failed = any(block.failure for trials in again for block in trials)
    return math.inf if failed else sum(max(block.cpu_ns for block in trials) for trials in again)


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
