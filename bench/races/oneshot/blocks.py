"""Times one task block by block, with fresh data and with a clock of the parent beside the child's.

A child that reports less time than its process used, or more than elapsed, did not time its work. A call costs some
microseconds beside the timed work, and a message some hundreds.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter_ns

import numpy as np

from bench.derived.accuracy import TOLERANCE
from bench.messages.task import NO_SETTING, Outcome, Task
from bench.messages.verdict import Status, Tier
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.processes.solver_child import SolverChild
from bench.races.metrics import judge, relative_gap
from bench.races.oneshot.worker import Block, BlockOutcome, End, OneShot
from bench.timing.clock import LONG_NS, Effort
from solvers.arrays import Matrix

SHORTEST_NS = 40
"""Shortest plausible median of a call from Python, copy of the answer included."""
BLOCK_OVERHEAD_NS, CALL_OVERHEAD_NS = 1_000_000, 8_000
"""CPU time of a block for its messages, and of each call beside the timed work, that raises no suspicion."""
IDLE_RATIO = 2.0
"""Allowed ratio of the CPU time beside the timed work to that of the null solver."""
CPU_RATIO = 3.0
"""Largest ratio of mean CPU time to median reported time."""
LEAST_CALLS, FEWEST_LONG_CALLS = 30, 8
"""Least number of calls in a block that tests for hidden work; the second one applies to long calls."""
GAP_RATIO = 100.0
"""Smallest ratio of two cost gaps that counts as a difference."""
TRIALS, POSITIVE = 5, 4
"""Number of blocks that test a suspicion, and how many of them must confirm it, since the machine may disturb one."""
REPEATED_CALLS, CACHE_RATIO, CACHE_NS, LONGEST_REPEATED_NS = 8, 5.0, 2_000, 1_000_000
"""Test for a cache: number of repeated calls, least speed-up and least gain by repeated data, longest call tested."""


class BlockError(Exception):
    """A solver failed at a block; the argument is the outcome."""


@dataclass
class Measurement:
    """The outcome of a task with its times, and the judgement of its timed answers."""

    outcome: Outcome
    timed_gap: float = math.nan
    """The largest cost gap or violation of the sampled answers; infinite if one of them is not finite."""
    fault: tuple[Status, str] | None = None
    """The first fault in the way in which the solver was timed."""


def set_up(child: SolverChild, task: Task, form: CertifiedForm) -> Outcome:
    """Set up the solver of a task, which then waits for blocks; the outcome has its first answer."""
    return child.ask(OneShot.of(task, form, child.entry.times_itself))


def run_block(
    child: SolverChild, task: Task, P: Matrix, q: Matrix, inspect: bool = False, most_ns: float = math.inf
) -> BlockOutcome:
    """Time a block. No call begins after ``most_ns``; ``inspect`` is whether to look for objects that the solver
    replaced. BlockError if the solver fails; if its process ended, so did the solver that was ready."""
    cpu_ns, begin = child.cpu_ns(), perf_counter_ns()
    block = child.ask(Block(task.key, P, q, inspect, most_ns))
    wall_ns, cpu_ns = perf_counter_ns() - begin, child.cpu_ns() - cpu_ns
    if block.failure:
        raise BlockError(block)
    if isinstance(block, BlockOutcome):
        n = len(q) if wall_ns < most_ns else min(len(block.answers), len(q))
        if n and block.answers.shape == (n, q.shape[1]) and block.update_ns.shape == block.solve_ns.shape == (n,):
            block.wall_ns, block.cpu_ns = wall_ns, cpu_ns
            return block
    raise BlockError(Outcome("tampered", "its process sent an answer that was not requested"))


def joined(blocks: Sequence[BlockOutcome]) -> BlockOutcome:
    """The calls of several blocks as one."""
    return BlockOutcome(
        preemptions=sum(block.preemptions for block in blocks),
        update_ns=np.concatenate([block.update_ns for block in blocks]),
        solve_ns=np.concatenate([block.solve_ns for block in blocks]),
        answers=np.concatenate([block.answers for block in blocks]),
    )


def _impossible_times(block: BlockOutcome, compiled: bool) -> str:
    """Why the times of a block are impossible, or ""."""
    if min(block.update_ns.min(), block.solve_ns.min()) < 0:
        return "times are negative"
    reported_ns, median_ns = int(block.calls_ns.sum()), float(np.median(block.calls_ns))
    if median_ns < (1 if compiled else SHORTEST_NS):
        return f"an update and a solve in {median_ns:g} ns cannot be"
    if reported_ns > block.wall_ns:
        return f"{reported_ns / 1e3:.0f} µs are reported, and {block.wall_ns / 1e3:.0f} went by"
    return ""


def cpu_ratio(block: BlockOutcome, allowed_ns: float) -> float:
    """Ratio of the mean CPU time of a call beyond the allowance to the median reported time."""
    return (block.cpu_ns - allowed_ns) / (block.calls_ns.size * max(float(np.median(block.calls_ns)), 1.0))


def hidden_cpu_time(
    child: SolverChild, idle: SolverChild, task: Task, form: CertifiedForm, fresh: FreshData, n: int, call_ns: float
) -> str:
    """Evidence that the solver works while it is not timed: before or after its calls, or in a few of them; "" if none,
    or if the null solver fails.

    Blocks of ``n`` calls are tested, or of fewer if calls of ``call_ns`` would take longer than LONG_NS. Hidden work
    shows as CPU time far beyond the median reported time and beyond that of the null solver for the same block. A
    solver for which some data are harder shows the same; but the same data in another order are hard for it again.
    """
    ratios: list[float] = []
    null_task = replace(task, solver=idle.entry.name, lane=idle.entry.lane, setting=NO_SETTING)
    set_up(idle, null_task, form)
    calls = min(max(n, LEAST_CALLS), fresh.calls_at_once, max(FEWEST_LONG_CALLS, int(LONG_NS / call_ns)))
    for remaining in reversed(range(TRIALS)):
        P, q = fresh.unseen(calls)
        order = np.random.default_rng().permutation(len(q))
        block = run_block(child, task, P, q)
        shuffled = run_block(child, task, P[order], q[order])
        try:
            null_block = run_block(idle, null_task, P, q)
        except BlockError:
            break
        ratio = min(cpu_ratio(each, IDLE_RATIO * null_block.cpu_ns) for each in (block, shuffled))
        median_ns, shuffled_median_ns = np.median(block.calls_ns), np.median(shuffled.calls_ns)
        is_hard = block.calls_ns[order] > CPU_RATIO * median_ns
        hard_again = is_hard.any() and np.median(shuffled.calls_ns[is_hard]) > CPU_RATIO / 2 * shuffled_median_ns
        if ratio > CPU_RATIO and not hard_again:
            ratios.append(ratio)
        if len(ratios) + remaining < POSITIVE:
            break
    if len(ratios) < POSITIVE:
        return ""
    return f"its process takes {ratios[0]:.1f} times as much CPU time as most of its calls report"


def timed(
    child: SolverChild,
    idle: SolverChild,
    task: Task,
    problem: RaceProblem,
    fresh: FreshData,
    effort: Effort,
    test_for_cheating: bool = True,
) -> Measurement:
    """Time a task; BlockError if the solver fails at a block, also at one that tests for cheating.

    ``idle`` is the process of the null solver; ``test_for_cheating`` adds the tests for hidden work and for a cache.
    """
    form = problem.forms[task.scaling]
    outcome = set_up(child, task, form)
    if outcome.failure:
        return Measurement(outcome)
    blocks: list[BlockOutcome] = []
    fault, size, done, spent_ns = None, 1, 0, 0
    while effort.goes_on(done, spent_ns):
        n = min(size, fresh.calls_at_once, effort.most - done)
        most_ns = max(effort.budget_s * 1e9, LONG_NS if done < effort.fewest else 0.0) - spent_ns
        block = run_block(child, task, *fresh.block(done, done + n), inspect=True, most_ns=most_ns)
        blocks.append(block)
        n, evidence = len(block.answers), _impossible_times(block, child.entry.times_itself)
        done, spent_ns = done + n, spent_ns + int(block.calls_ns.sum())
        is_suspect = cpu_ratio(block, BLOCK_OVERHEAD_NS + n * CALL_OVERHEAD_NS) > CPU_RATIO
        if is_suspect and test_for_cheating and child is not idle and not (evidence or fault):
            evidence = hidden_cpu_time(child, idle, task, form, fresh, n, block.cpu_ns / n)
        if evidence and not fault:
            fault = Status.MISTIMED, evidence
        call_ns = max(spent_ns / done, 1.0)
        size = max(effort.fewest - done, math.ceil((effort.budget_s * 1e9 - spent_ns) / call_ns), 1)
    if test_for_cheating:
        fault = fault or _cached_answers(child, task, fresh, call_ns)
    end = child.ask(End(task.key, effort.budget_s))
    if end.failure:
        return Measurement(end)
    if actions := end.forbidden_actions:
        fault = Status.PEEKED if actions[0].startswith("opened") else Status.TAMPERED, "; ".join(actions)
    if outcome.returned:
        fault = fault or (Status.LAZY, f"returned a {outcome.returned} and no array")
    calls = joined(blocks)
    gaps = _gaps(fresh, calls.answers)
    fault = fault or _wrong_answers(problem, task, fresh, outcome, calls.answers, gaps)
    outcome = replace(
        outcome,
        update_ns=calls.update_ns,
        solve_ns=calls.solve_ns,
        preemptions=calls.preemptions,
        setup_ns=end.setup_ns,
        repeatable=end.repeatable,
        mutated=end.mutated,
    )
    return Measurement(outcome, max(gaps.values(), default=math.nan), fault)


def _cached_answers(child: SolverChild, task: Task, fresh: FreshData, call_ns: float) -> tuple[Status, str] | None:
    """Whether repeated data are answered far faster, in every trial; other data come in between, so that a warm start
    does not explain it."""
    if call_ns > LONGEST_REPEATED_NS:
        return None
    ratios, calls = [], max(2, min(REPEATED_CALLS, round(1e6 / call_ns), fresh.calls_at_once // 2))
    for _ in range(TRIALS):
        P, q = fresh.unseen(calls)
        block = run_block(child, task, np.concatenate([P, P]), np.concatenate([q, q]))
        first, again = int(block.calls_ns[:calls].min()), max(float(np.median(block.calls_ns[calls:])), 1.0)
        if first < CACHE_RATIO * again or first - again < CACHE_NS:
            return None
        ratios.append(first / again)
    return Status.CACHED, f"data that it has seen before are answered {min(ratios):.1f} times as fast"


def _gaps(fresh: FreshData, answers: Matrix) -> dict[int, float]:
    """The larger of cost gap and violation of the sampled answers (n, d), if the optimum has a certificate."""
    gaps = {}
    for call in fresh.sample:
        if call < len(answers) and (form := fresh.certified(call)) is not None:
            x = answers[call]
            gaps[call] = max(relative_gap(form, x)) if np.isfinite(x).all() else math.inf
    return gaps


def _wrong_answers(
    problem: RaceProblem, task: Task, fresh: FreshData, outcome: Outcome, answers: Matrix, gaps: dict[int, float]
) -> tuple[Status, str] | None:
    """Whether a timed answer belongs to other data, or most of them are about as far from the optimum as zeros are
    while the first answer is near."""
    first = judge(problem, task.scaling, outcome)
    first_gap = max(first.cost_gap, first.violation)
    worse = {call: gap for call, gap in gaps.items() if first_gap * GAP_RATIO < gap < math.inf}
    for call, gap in worse.items():
        others = [problem.forms[task.scaling], fresh.certified(call - 1) if call else None]
        if any(other is not None and max(relative_gap(other, answers[call])) < gap / GAP_RATIO for other in others):
            return Status.STALE, f"answer {call + 1} is that of other data (gap {gap:.1e})"
    wrong = []
    for call, gap in worse.items():
        certified = fresh.certified(call)
        assert certified is not None  # since it has a gap
        gap_of_zero, _ = relative_gap(certified, np.zeros_like(answers[call]))
        if first_gap <= TOLERANCE[Tier.LOW] and gap > max(0.5 * gap_of_zero, GAP_RATIO * TOLERANCE[Tier.LOW]):
            wrong.append(gap)
    if len(wrong) > len(gaps) / 2:
        return Status.ERRATIC, (
            f"{len(wrong)} of {len(gaps)} timed answers are wrong where the first one is right (gap {max(wrong):.1e})"
        )
    return None
