"""The child's side of the one-shot race: solve one problem, time it again and again, and in turns with other solvers.

*Hot*: update and solve of the same solver again and again, so that its code and data are in the caches. *Interleaved*: the
solver is set up, and then asked for one update and solve at a time, between which other solvers have their turn on the
same core. The clock is here in both; the parent only says whose turn it is.
"""

from __future__ import annotations

import resource
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from qpsolvers import Problem

from bench.passed.outcome import Outcome
from bench.passed.request import Request, attempt
from bench.passed.said import Said, real
from bench.passed.task import Task
from bench.timing.clock import Effort, time_call, time_kernel, time_pairs
from solvers.protocol import Nanoseconds, Solver

Vector = NDArray[np.float64]
Pairs = tuple[Nanoseconds, Nanoseconds]

ONE = Effort(0.0, 1, 1)
QP_FIELDS = ("P", "q", "G", "h", "A", "b", "lb", "ub")


@dataclass(frozen=True)
class OneShot(Request):
    """Solve one problem and time it.

    Attributes
    ----------
    task : Task
    fields : mapping
        The program by field.
    effort : Effort
    warm_start : array (d,), optional
        What every solve starts from; None for cold solves.
    c : float
        The constant that the solver's ladder is made for.
    """

    task: Task
    fields: Mapping[str, Any]
    effort: Effort
    warm_start: Vector | None = None
    c: float = 1.0

    @classmethod
    def of(cls, task: Task, problem: Problem, effort: Effort, warm_start: Vector | None = None, c: float = 1.0) -> Self:
        """The request for a program."""
        return cls(task, {name: getattr(problem, name) for name in QP_FIELDS}, effort, warm_start, c)

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Run the task, at first once more to warm up; the same failures come again then."""
        problem = Problem(**self.fields)
        if first:
            run_task(cls, self.task, problem, self.c, ONE, self.warm_start)
        return run_task(cls, self.task, problem, self.c, self.effort, self.warm_start)


class Bench:
    """A solver that is set up on a problem, with data of its own for updates.

    Parameters
    ----------
    cls, task, problem, c, warm_start
        As of :class:`OneShot`.
    """

    def __init__(self, cls: type[Solver], task: Task, problem: Problem, c: float, warm_start: Vector | None) -> None:
        self._given = problem, warm_start
        # A solver that writes into one spoils neither the other nor ours.
        self._handed, self._updated = copied(problem), copied(problem)
        self._start = None if warm_start is None else warm_start.copy()
        self._kernel = task.lane.times_itself
        self.asked = task.asked(cls, c)
        self.solver = cls(**self.asked)
        P = self._updated.P if isinstance(self._updated.P, np.ndarray) else self._updated.P.toarray()
        self._update = partial(self.solver.update, P=P, q=self._updated.q)  # update takes dense data
        self.solve: Callable[[], Vector] = (self.solver.solve if self._start is None else
                                            partial(self.solver.solve, self._start))

    def setup(self) -> None:
        """Set the solver up."""
        self.solver.setup(self._handed)

    def pairs(self, effort: Effort) -> Pairs:
        """Nanoseconds of updates and solves in turns."""
        if self._kernel:
            return time_kernel(self.solver, self._update, effort, self._start)
        return time_pairs(self._update, self.solve, effort)

    def were_inputs_changed(self) -> bool:
        """Whether the solver wrote into what it was given."""
        problem, warm_start = self._given
        pairs = [pair for taken in (self._handed, self._updated) for pair in
                 zip(arrays(problem), arrays(taken), strict=True)]
        pairs += [] if warm_start is None else [(warm_start, self._start)]
        return any(not np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def run_task(cls: type[Solver], task: Task, problem: Problem, c: float, effort: Effort, warm_start: Vector | None = None) -> Outcome:
    """Solve one problem, then time setup, update and solve."""
    made: list[Bench] = []

    def work() -> Outcome:
        made.append(Bench(cls, task, problem, c, warm_start))
        return _solve_and_time(made[0], lambda: Bench(cls, task, problem, c, warm_start), effort)

    outcome = attempt(work)
    outcome.mutated = any(bench.were_inputs_changed() for bench in made)
    outcome.asked = made[0].asked if made else {}
    return outcome


def _solve_and_time(bench: Bench, another: Callable[[], Bench], effort: Effort) -> Outcome:
    setups = [time_call(bench.setup)]
    first = real(bench.solve())
    said = Said.of(bench.solver.solution())
    before = preemptions()
    updates, solves = bench.pairs(effort)
    taken_off = preemptions() - before
    again = real(bench.solve())
    for _ in range(2):
        if sum(setups) < effort.budget_s * 1e9:
            setups.append(time_call(another().setup))
    return Outcome(found=said.found, x=first, y=said.y, z=said.z, z_box=said.z_box, solver_status=said.status,
                   reported_us=said.time_us, iterations=said.iterations,
                   repeatable=bool(np.array_equal(first, again, equal_nan=True)), preemptions=taken_off,
                   setup_ns=np.array(setups, dtype=np.int64), update_ns=updates, solve_ns=solves)


def preemptions() -> int:
    """How often this process was taken off its core so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_nivcsw


_ready: dict[str, tuple[Bench, list[Pairs]]] = {}
"""Solvers of this process that wait for their turns, by task, and the times so far."""


@dataclass(frozen=True)
class Prepare(OneShot):
    """Set a solver up for its turns, and let it have one that does not count."""

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Keep the solver."""
        def work() -> Outcome:
            bench = Bench(cls, self.task, Problem(**self.fields), self.c, self.warm_start)
            bench.setup()
            bench.pairs(self.effort)
            _ready[self.task.key] = bench, []
            return Outcome()

        return attempt(work)


@dataclass(frozen=True)
class Turn(Request):
    """One update and solve of the solver that was prepared for the task of this key."""

    key: str

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Time it."""
        def work() -> Outcome:
            bench, times = _ready[self.key]
            times.append(bench.pairs(ONE))
            return Outcome()

        return attempt(work)


@dataclass(frozen=True)
class Collect(Request):
    """Hand over the times of all turns and forget the solver."""

    key: str

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Return an outcome with times only."""
        def work() -> Outcome:
            _, times = _ready.pop(self.key)
            updates, solves = zip(*times, strict=True)
            return Outcome(update_ns=np.concatenate(updates), solve_ns=np.concatenate(solves))

        return attempt(work)


def copied(problem: Problem) -> Problem:
    """A problem with arrays of its own."""
    return Problem(*(None if value is None else value.copy() for value in _fields(problem)))


def arrays(problem: Problem) -> list[Any]:
    """Every array of a problem, those of sparse matrices too."""
    return [part for value in _fields(problem) if value is not None
            for part in ([value] if isinstance(value, np.ndarray) else [value.data, value.indices, value.indptr])]


def _fields(problem: Problem) -> tuple[Any, ...]:
    return problem.P, problem.q, problem.G, problem.h, problem.A, problem.b, problem.lb, problem.ub
