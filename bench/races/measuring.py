"""Times tasks block by block, with fresh data and with a clock of the parent beside the child's: one task alone, or
several interleaved.

The parent knows the processor time of the child's process, and that of the null solver for the same blocks. Their
difference is what the calls cost, whatever the child reports and wherever in a block it does its work. If it is far
above the median of the times, a few slow calls or another process are the reason, or calls that were answered ahead of
the clock, with the data of their block. So a further block takes the place of those before, up to MAX_RETRIES times,
and the time of an answer counts as no less than two thirds of what remains. Messages cost some hundreds of
microseconds a block, which differ between two processes, so that less than UNSEEN_NS remains unseen. In a block of few
calls that would be all of their time, and how many calls a block has follows from what the child reports. So there is
at least one block whose calls take LONG_BLOCK times as long by their median, or are as many as there may be.

A row holds the accuracy and the times of one measurement, independent of tiers.
"""

import math
import random
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise, repeat

import numpy as np

from bench.derived.measurements import NULL_SOLVER
from bench.messages.solver_info import amount
from bench.messages.task import MOST, NO_SETTING, PAPER, Outcome, Row, Status, Task
from bench.problem_files.program import fields_of
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.processes.child_process import NOT_REQUESTED
from bench.processes.solver_child import SolverChild
from bench.race_table import complete
from bench.races import worker
from bench.races.metrics import judge, judge_timed
from bench.races.worker import TimedSolver
from bench.timing.clock import LEAST_SHARE, LONG_NS, Effort, answers_us
from bench.timing.percentiles import percentile
from bench.timing.schedule import PERIOD_NS, runs
from solvers.protocol import Lane, Matrix, Vector

NOTHING = np.zeros((0, 0))
PER_CALL = ("update", "solve", "sample")
"""Names of times, and of the sample, that there are of each call."""
UNSEEN_NS = 250_000
"""Processor time of a block by which two processes may differ that do the same."""
MAX_RETRIES, LONG_BLOCK = 4, 4.0
"""Most further blocks in place of some whose processor time is far above that of their calls; time of the calls of at
least one block, in units of what remains unseen."""
TRIALS = 3
"""Number of blocks of the null solver, of which the longest counts."""


def requested(outcome: Outcome, q: Matrix = NOTHING, *times: str, fewest: int = 0) -> Outcome:
    """The outcome if it has answers to the first of the data ``q`` (n, d), and these times of each, or is a failure
    without any; else its process has tampered. ``response`` is of each of the data, and ``setup`` of several set-ups.
    """
    if outcome.failure:
        q, times, fewest = NOTHING, (), 0
    calls = len(outcome.answers)
    sizes = {"response": len(q), "setup": outcome.times.get("setup", NOTHING).size} | dict.fromkeys(PER_CALL, calls)
    if (
        not fewest <= calls <= len(q)
        or outcome.answers.shape != (calls, q.shape[1])
        or outcome.times.keys() != {*times}
        or not all(
            ns.shape == (sizes[name],) and ((ns >= 0) & (ns <= MOST)).all() for name, ns in outcome.times.items()
        )
    ):
        return Outcome(Status.TAMPERED, f"its process {NOT_REQUESTED}")
    return outcome


def set_up(child: SolverChild, task: Task, form: CertifiedForm) -> Outcome:
    """Set up the solver of a task, which then waits for blocks; the outcome has its first answer. The certificate and
    the other windows stay here."""
    program, start = fields_of(form.qp), form.starts.get(task.start)
    outcome = requested(child.ask(worker.set_up, task, program, start, form.unit, child.entry.times_itself))
    if outcome.failure == Status.TIMED_OUT:
        return replace(outcome, message=f"its set-up gave {outcome.message}")
    return outcome if outcome.failure else requested(child.ask(worker.further, task.key, TimedSolver.first))


def run_block(child: SolverChild, task: Task, P: Matrix | None, q: Matrix, most_ns: float = math.inf) -> Outcome:
    """Time a block of `bench.problems.fresh`. No call begins after ``most_ns``. It may be a failure; if the process
    ended, so did the solver that was ready."""
    cpu_ns = child.cpu_ns()
    block = requested(
        child.ask(worker.further, task.key, TimedSolver.block, P, q, most_ns),
        q,
        *("update", "solve"),
        fewest=1 if most_ns < math.inf else len(q),
    )
    return replace(block, cpu_ns=0.0 if block.failure else child.cpu_ns() - cpu_ns)


def timed(
    child: SolverChild, null: SolverChild, task: Task, form: CertifiedForm, fresh: FreshData, effort: Effort
) -> Outcome:
    """Time a task; ``null`` is the process of the null solver."""
    outcome = set_up(child, task, form)
    if outcome.failure:
        return outcome
    blocks, most = list[Outcome](), min(effort.most, fresh.calls_at_once)
    size, done, spent_ns, longest, needed, retries, hidden = 1, 0, 0, 0, 0, 0, 0.0
    while (
        (goes_on := effort.goes_on(done, spent_ns))
        or longest < needed
        or (
            (hidden := hidden_ns(blocks, repeat(0.0)) and hidden_ns(blocks, _null_ns(null, task, form, fresh, blocks)))
            and retries < MAX_RETRIES
        )
    ):
        n = min(size, most, effort.most - done) if goes_on else max(longest, needed)
        if not goes_on:
            retries, blocks = retries + (longest >= needed), []
        most_ns = max(effort.budget_s * 1e9, LONG_NS if done < effort.fewest else 0.0) - spent_ns
        block = run_block(child, task, *fresh.block(done, done + n), most_ns if goes_on else math.inf)
        if block.failure:
            return block
        blocks.append(block)
        done, spent_ns = done + len(block.answers), spent_ns + int(sum(ns.sum() for ns in block.times.values()))
        size = max(effort.fewest - done, math.ceil((effort.budget_s * 1e9 - spent_ns) * done / max(spent_ns, done)), 1)
        longest, needed = (
            max(len(own.answers) for own in blocks),
            min(most, math.ceil(LONG_BLOCK * UNSEEN_NS / max(reported_ns(blocks), 1.0))),
        )
    end = requested(
        child.ask(worker.further, task.key, TimedSolver.end, effort.budget_s, not form.windows), NOTHING, "setup"
    )
    if end.failure:
        return end
    return with_calls(
        replace(outcome, times=end.times, repeatable=end.repeatable, mutated=end.mutated),
        blocks,
        hidden,
        done - sum(len(block.answers) for block in blocks),
    )


def scheduled(child: SolverChild, task: Task, form: CertifiedForm, fresh: FreshData) -> Outcome:
    """Run a task on the schedule, as many samples at once as fit into a message. Waiting takes processor time, so that
    the child's clock is not checked."""
    outcome, blocks = set_up(child, task, form), list[Outcome]()
    if outcome.failure:
        return outcome
    for first in range(0, fresh.count, fresh.calls_at_once):
        P, q = fresh.block(first, min(first + fresh.calls_at_once, fresh.count))
        block = requested(
            child.ask(worker.further, task.key, TimedSolver.scheduled, P, q), q, *PER_CALL, "response", fewest=1
        )
        if block.failure:
            return block
        sample = block.times["sample"]
        if not ((np.diff(sample, prepend=-1) > 0).all() and sample[-1] == len(q) - 1):
            return Outcome(Status.TAMPERED, f"its process {NOT_REQUESTED}")
        blocks.append(replace(block, times={**block.times, "sample": sample + first}))
    return with_calls(outcome, blocks)


def hidden_ns(blocks: Sequence[Outcome], null_ns: Iterable[float]) -> float:
    """Processor time of the calls beyond ``null_ns`` in each block; 0 if LEAST_SHARE of it is below the median time of
    the calls."""
    used_ns = sum(block.cpu_ns - ns - UNSEEN_NS for block, ns in zip(blocks, null_ns, strict=False))
    return used_ns if LEAST_SHARE * used_ns > sum(len(block.answers) for block in blocks) * reported_ns(blocks) else 0.0


def reported_ns(blocks: Sequence[Outcome]) -> float:
    """Median of the reported times of the calls."""
    return 1e3 * median(np.concatenate([answers_us(block.times["update"], block.times["solve"]) for block in blocks]))


def with_calls(outcome: Outcome, blocks: Sequence[Outcome], hidden: float = 0.0, first_call: int = 0) -> Outcome:
    """The outcome of a task with the calls of its blocks, the number of the first one, and what they hide."""
    return replace(
        outcome,
        times={
            **outcome.times,
            **{name: np.concatenate([block.times[name] for block in blocks]) for name in blocks[0].times},
        },
        answers=np.concatenate([block.answers for block in blocks]),
        preemptions=sum(block.preemptions for block in blocks),
        cpu_ns=hidden,
        first_call=first_call,
    )


def _null_ns(
    null: SolverChild, task: Task, form: CertifiedForm, fresh: FreshData, blocks: Sequence[Outcome]
) -> Iterable[float]:
    """Processor time of the null solver for the data of each of consecutive blocks; infinite if it fails, and for
    itself."""
    if task.solver == null.entry.name:
        return repeat(math.inf)
    null_task = replace(task, solver=null.entry.name, lane=null.entry.lane, setting=NO_SETTING)
    ends = np.cumsum([len(block.answers) for block in blocks])
    set_up(null, null_task, form)
    return [
        max(
            math.inf if block.failure else block.cpu_ns
            for block in (run_block(null, null_task, *fresh.block(first, last)) for _ in range(TRIALS))
        )
        for first, last in pairwise([0, *ends])
    ]


def interleave(
    tasks: Sequence[Task],
    children: Mapping[tuple[str, Lane], SolverChild],
    form: CertifiedForm,
    fresh: FreshData,
    seed: str,
    calls: int = 1,
) -> list[tuple[Task, Outcome]]:
    """The interleaved solves of each task.

    Parameters
    ----------
    tasks : sequence of Task
        All on one problem in one scaling, one for each solver lane, whose process keeps one solver ready.
    children : mapping
        Processes by name and lane.
    form : CertifiedForm
        The problem of the set-up.
    fresh : FreshData
        Data of the rounds.
    seed : str
        Determines the order in each round.
    calls : int
        Number of calls in a round.
    """
    chance = random.Random(seed)
    outcomes = {task.key: set_up(children[task.solver, task.lane], task, form) for task in tasks}
    ready = [task for task in tasks if not outcomes[task.key].failure]
    blocks: dict[str, list[Outcome]] = {task.key: [] for task in ready}
    for at in range(-calls, fresh.count, calls):  # the first round warms up
        chance.shuffle(ready)
        data = fresh.block(at, at + calls) if at >= 0 else fresh.block(fresh.count, fresh.count + calls)
        for task in list(ready):
            block = run_block(children[task.solver, task.lane], task, *data)
            if block.failure:
                ready.remove(task)
                outcomes[task.key] = block
            elif at >= 0:
                blocks[task.key].append(block)
    null_ns = [block.cpu_ns for task in ready if task.solver == NULL_SOLVER for block in blocks[task.key]]
    outcomes |= {
        task.key: with_calls(
            outcomes[task.key], blocks[task.key], hidden_ns(blocks[task.key], null_ns or repeat(math.inf))
        )
        for task in ready
    }
    return [(task, outcomes[task.key]) for task in tasks]


def row_of(problem: RaceProblem, task: Task, outcome: Outcome, fresh: FreshData | None, few: int, machine: str) -> Row:
    """The row of a task, whose timed answers are to ``fresh`` data; at most ``few`` are judged in exact arithmetic.

    A percentile is NaN if the sample is too small for it.
    """
    validation, judgement = problem.validation, judge(problem, task.scaling, outcome)
    setup, update, solve = (
        outcome.times.get(name, np.zeros(0, dtype=np.int64)) for name in ("setup", "update", "solve")
    )
    calls = outcome.times.get("sample", outcome.first_call + np.arange(solve.size))
    response = outcome.times.get("response", np.zeros(0))
    cpu_us, x = (outcome.cpu_ns or math.nan) / max(solve.size, 1) / 1e3, outcome.x
    us, solve_us = answers_us(update, solve, cpu_us), solve / 1e3
    span_um = math.nan if validation is None else validation.span_um
    return complete(
        **{
            **task.columns(outcome.settings),
            "task": task.subject,
            "machine": machine,
            "digest": problem.digest,
            "period_us": problem.period_us,
            **judgement,
            "timed_call": -1,
            **(judge_timed(problem, fresh, calls, outcome.answers, few) if fresh is not None else {}),
            "answer": () if x is None or x.ndim != 1 else tuple(map(float, x)),
            "model_error_um": judgement.get("model_error_percent", math.nan) / 100.0 * span_um,
            "optimum_error_um": problem.optimum_error_percent / 100.0 * span_um,
            "noise_um": math.nan if validation is None else validation.noise_um,
            "setup_us": median(setup / 1e3),
            "update_us": median(update / 1e3),
            "solve_us_p50": median(solve_us),
            "solve_us_p99": percentile(solve_us, 0.99),
            "solve_us_max": float(solve_us.max()) if solve.size else math.nan,
            "answer_us": median(us),
            "cpu_us": cpu_us,
            "samples": int(solve.size),
            # the settings of any other solver may have this name too
            "periods": amount(outcome.settings.get("steps"))
            if task.solver == PAPER
            else median(us) / problem.period_us,
            "reported_us": outcome.reported_us,
            "iterations": outcome.iterations,
            "mutates_input": outcome.mutated,
            "repeatable": outcome.repeatable,
            "preemptions": outcome.preemptions,
            "due": response.size,
            "late": int((response > PERIOD_NS).sum()),
            "bouts": runs(response > PERIOD_NS),
        }
    )


def median(values: Vector) -> float:
    """Median; NaN of an empty array."""
    return float(np.median(values)) if values.size else math.nan
