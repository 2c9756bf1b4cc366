"""How the parent times one task: block by block, with data that it makes, by a clock of its own beside the child's.

A child that reports less than its process took, or more than went by, did not time what it did. Calls cost some
microseconds beside what is timed, and a message some hundreds.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from time import perf_counter_ns

import numpy as np

from bench.derived.accuracy import TOLERANCE
from bench.messages.task import NO_SETTING, Outcome, Task
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.processes.solver_child import SolverChild
from bench.races.metrics import relative_gap
from bench.races.oneshot.worker import Answered, Block, End, OneShot
from bench.timing.clock import LONG_NS, Effort
from solvers import Status, Tier
from solvers.arrays import Matrix
from solvers.protocol import Nanoseconds

LEAST_NS = 40
"""Shorter than a call from Python and a copy of an array can be."""
ASIDE_NS, ASIDE_EACH_NS = 1_000_000, 8_000
"""Processor time of a block for its messages, and for each call, that is nothing to look into."""
IDLE = 2.0
"""Largest ratio of the time beside its calls to that of a solver that does nothing."""
FEW = 3.0
"""Largest ratio of mean CPU time to median reported time of its calls."""
LEAST_CALLS, FEWEST_CALLS = 30, 8
"""Calls of a block that is to show it, at least, and if they take long."""
FAR = 100.0
"""Smallest ratio of two cost gaps that counts as a difference."""
AGAIN, ENOUGH = 5, 4
"""Blocks more, and how many of them must look wrong before a solver is said to do it, since a machine may, now and
then."""
SEEN, QUICKEST, SEEN_NS, SLOW_NS = 8, 5.0, 2_000, 1_000_000
"""Calls whose data are shown again, how many times as fast they may be answered then, and how much faster; how long one
may take."""


@dataclass
class Timings:
    """What the blocks of a task gave, and what was wrong with them."""

    updates: list[Nanoseconds] = field(default_factory=list)
    solves: list[Nanoseconds] = field(default_factory=list)
    answers: list[Matrix] = field(default_factory=list)
    """Shape (n, d)."""
    gaps: dict[int, float] = field(default_factory=dict)
    """The larger of relative cost gap and violation of the answers that were sampled, by call; infinite for no
    answer."""
    preemptions: int = 0
    fault: tuple[Status, str] | None = None
    """The first thing that is wrong with the way in which it was timed."""

    @property
    def count(self) -> int:
        """Calls so far."""
        return sum(part.size for part in self.solves)

    @property
    def spent_ns(self) -> int:
        """What they took."""
        return int(sum(part.sum() for part in (*self.updates, *self.solves)))

    def take(self, block: Outcome) -> Outcome:
        """Add a block."""
        if isinstance(block, Answered):
            self.updates.append(block.update_ns)
            self.solves.append(block.solve_ns)
            self.answers.append(block.answers)
            self.preemptions += block.preemptions
        return block


def ask(
    child: SolverChild, task: Task, P: Matrix, q: Matrix, watch: bool = False, most_ns: float = math.inf
) -> Outcome:
    """A block, of which no call begins after ``most_ns``; ``watch`` is whether to look for what the process
    replaced."""
    used, began = child.cpu_ns(), perf_counter_ns()
    block = child.ask(Block(task.key, P, q, watch, most_ns))
    passed, used = perf_counter_ns() - began, child.cpu_ns() - used
    asked = q if passed < most_ns or not isinstance(block, Answered) else q[: len(block.answers)]
    if not isinstance(block, Answered) or not len(asked) or block.answers.shape != asked.shape:
        return block if block.failure else Outcome("tampered", "its process answers what it was not asked")
    block.passed_ns, block.used_ns = passed, used
    return block


def _impossible(block: Answered, compiled: bool) -> str:
    """Why the times of a block cannot be, or nothing."""
    n = len(block.answers)
    if block.solve_ns.size != n or block.update_ns.size != n or min(block.update_ns.min(), block.solve_ns.min()) < 0:
        return "times are missing or negative"
    told, middle = int(block.calls_ns.sum()), float(np.median(block.calls_ns))
    if middle < (1 if compiled else LEAST_NS):
        return f"an update and a solve in {middle:g} ns cannot be"
    return (
        f"{told / 1e3:.0f} µs are reported, and {block.passed_ns / 1e3:.0f} went by" if told > block.passed_ns else ""
    )


def cpu_overhead(block: Answered, allowed_ns: float) -> float:
    """How many times what its calls take in the median the process of a block took of the processor, beyond what is
    allowed."""
    return (block.used_ns - allowed_ns) / (block.calls_ns.size * max(float(np.median(block.calls_ns)), 1.0))


def hidden_cpu_time(
    child: SolverChild, idle: SolverChild, task: Task, form: CertifiedForm, fresh: FreshData, n: int, each: float
) -> str:
    """Whether most calls of blocks of n are quick because their work is done elsewhere: before they are timed, after,
    or in another call.

    Calls that take ``each`` nanoseconds in the mean are fewer where those of a block would take longer than LONG_NS.

    The process then takes far more of the processor than most calls say, whatever it waits for, and beyond what a
    process takes that does nothing for the same blocks. A solver to which some data come harder is distinguished from
    that by the same data in another order: they come harder again.
    """
    found, nothing = [], replace(task, solver=idle.entry.name, lane=idle.entry.lane, setting=NO_SETTING)
    idle.ask(OneShot.of(nothing, form))
    calls = min(max(n, LEAST_CALLS), fresh.calls_at_once, max(FEWEST_CALLS, int(LONG_NS / each)))
    for left in reversed(range(AGAIN)):
        P, q = fresh.unseen(calls)
        order = np.random.default_rng().permutation(len(q))
        first, other, spent = ask(child, task, P, q), ask(child, task, P[order], q[order]), ask(idle, nothing, P, q)
        if not (isinstance(first, Answered) and isinstance(other, Answered) and isinstance(spent, Answered)):
            break
        more = min(cpu_overhead(block, IDLE * spent.used_ns) for block in (first, other))
        hard = first.calls_ns[order] > FEW * np.median(first.calls_ns)
        again = hard.any() and np.median(other.calls_ns[hard]) > FEW / 2 * np.median(other.calls_ns)
        if more > FEW and not again:
            found.append(more)
        if len(found) + left < ENOUGH:
            break
    return (
        f"its process takes {found[0]:.1f} times as much of the processor as most of its calls say"
        if len(found) >= ENOUGH
        else ""
    )


def timed(
    child: SolverChild,
    idle: SolverChild,
    task: Task,
    problem: RaceProblem,
    fresh: FreshData,
    effort: Effort,
    look_closer: bool = True,
) -> tuple[Outcome, Timings]:
    """The outcome of a task with its times, and what was seen of it.

    ``idle`` is the process of a solver that does nothing; ``look_closer`` is whether it is looked into where
    the solver works while nobody times it, and whether it answers from memory.
    """
    form, timings, size = problem.forms[task.scaling], Timings(), 1
    compiled = child.entry.times_itself
    outcome = child.ask(OneShot.of(task, form, times_itself=compiled))
    if outcome.failure:
        return outcome, timings
    while effort.goes_on(timings.count, timings.spent_ns):
        done = timings.count
        n = min(size, fresh.calls_at_once, effort.most - done)
        most_ns = max(effort.budget_s * 1e9, LONG_NS if done < effort.fewest else 0.0) - timings.spent_ns
        block = ask(child, task, *fresh.block(done, done + n), watch=True, most_ns=most_ns)
        if not isinstance(block, Answered):
            return block, timings
        timings.take(block)
        n, found = len(block.answers), _impossible(block, compiled)
        if (
            look_closer
            and child is not idle
            and not (found or timings.fault)
            and cpu_overhead(block, ASIDE_NS + n * ASIDE_EACH_NS) > FEW
        ):
            found = hidden_cpu_time(child, idle, task, form, fresh, n, block.used_ns / n)
        timings.fault = timings.fault or ((Status.MISTIMED, found) if found else None)
        each = max(timings.spent_ns / timings.count, 1.0)
        size = max(effort.fewest - timings.count, math.ceil((effort.budget_s * 1e9 - timings.spent_ns) / each), 1)
    if look_closer:
        timings.fault = timings.fault or _remembers(child, task, fresh, each)
    end = child.ask(End(task.key, effort.budget_s))
    if end.failure:
        return end, timings
    if end.seen:
        timings.fault = Status.PEEKED if end.seen[0].startswith("opened") else Status.TAMPERED, "; ".join(end.seen)
    if outcome.returned:
        timings.fault = timings.fault or (Status.LAZY, f"returned a {outcome.returned} and no array")
    answers = np.concatenate(timings.answers)
    timings.gaps = _judged(fresh, answers)
    timings.fault = timings.fault or _of_other_data(form, fresh, outcome, answers, timings.gaps)
    return replace(
        outcome,
        update_ns=np.concatenate(timings.updates),
        solve_ns=np.concatenate(timings.solves),
        preemptions=timings.preemptions,
        setup_ns=end.setup_ns,
        repeatable=end.repeatable,
        mutated=end.mutated,
    ), timings


def _remembers(child: SolverChild, task: Task, fresh: FreshData, each: float) -> tuple[Status, str] | None:
    """Whether the same data again are answered far faster, time after time; others come between, of which a solver may
    start."""
    if each > SLOW_NS:
        return None
    ratios, calls = [], max(2, min(SEEN, round(1e6 / each), fresh.calls_at_once // 2))
    for _ in range(AGAIN):
        P, q = fresh.unseen(calls)
        block = ask(child, task, np.concatenate([P, P]), np.concatenate([q, q]))
        if not isinstance(block, Answered):
            return None
        first, again = int(block.calls_ns[:calls].min()), max(float(np.median(block.calls_ns[calls:])), 1.0)
        if first < QUICKEST * again or first - again < SEEN_NS:
            return None
        ratios.append(first / again)
    return Status.CACHED, f"data that it has seen before are answered {min(ratios):.1f} times as fast"


def _judged(fresh: FreshData, answers: Matrix) -> dict[int, float]:
    """How far the sampled of the answers (n, d) are from right; those whose optimum cannot be proven are not judged."""
    proven = {
        call: form for call in fresh.sample if call < len(answers) and (form := fresh.certified(call)) is not None
    }
    return {
        call: max(relative_gap(form, answers[call])) if np.isfinite(answers[call]).all() else math.inf
        for call, form in proven.items()
    }


def _of_other_data(
    form: CertifiedForm,
    fresh: FreshData,
    outcome: Outcome,
    answers: Matrix,
    gaps: Mapping[int, float],
) -> tuple[Status, str] | None:
    """Whether a timed answer is that of other data, or most are about as far from the optimum as zeros are where the
    first is near."""
    if outcome.x is None or outcome.x.shape != form.qp.q.shape or not np.isfinite(outcome.x).all() or not outcome.found:
        return None
    first = max(relative_gap(form, outcome.x))
    worse = {call: gap for call, gap in gaps.items() if first * FAR < gap < math.inf}  # NaN is said to be no answer
    for call, gap in worse.items():
        others = [form, fresh.certified(call - 1)] if call else [form]
        if any(other is not None and max(relative_gap(other, answers[call])) < gap / FAR for other in others):
            return Status.STALE, f"answer {call + 1} is that of other data (gap {gap:.1e})"
    zero = np.zeros_like(outcome.x)
    wrong = [
        gap
        for call, gap in worse.items()
        if first <= TOLERANCE[Tier.LOW]
        and (proven := fresh.certified(call)) is not None
        and gap > max(0.5 * relative_gap(proven, zero)[0], FAR * TOLERANCE[Tier.LOW])
    ]
    if len(wrong) > len(gaps) / 2:
        return Status.ERRATIC, (
            f"{len(wrong)} of {len(gaps)} timed answers are wrong where the first one is right (gap {max(wrong):.1e})"
        )
    return None
