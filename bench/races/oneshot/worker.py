"""The child's side of the one-shot race: solve one problem, then be timed on data that come block by block.

*Hot*: update and solve of the same solver again and again, so that its code is in the caches. *Interleaved*: one update
and solve at a time, between which other solvers have their turn on the same core. The clock is here in both; the data
of a block are not here before it, and its answers are handed back with its times. The parent holds both against clocks
and proofs of its own.
"""

from __future__ import annotations

import resource
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Self

import numpy as np
from qpsolvers import Problem

from bench.messages.solver_info import real, solver_info
from bench.messages.task import Outcome, Request, Task, attempt
from bench.problem_files.program import copied, fields_of
from bench.processes.worker import seen
from bench.timing.clock import time_block, time_call, time_kernel
from solvers.arrays import Matrix, Vector
from solvers.protocol import Nanoseconds, Solver


@dataclass
class Answered(Outcome):
    """What came back of a block: the answers (n, d) that were timed; the parent adds what went by and what its process
    took of the processor."""

    answers: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    passed_ns: int = 0
    used_ns: int = 0

    @property
    def calls_ns(self) -> Nanoseconds:
        """Update and solve of each call."""
        return self.update_ns + self.solve_ns


@dataclass(frozen=True)
class OneShot(Request):
    """Set a solver up, solve one problem, and keep the solver for the blocks that follow, until it is to set up another
    one."""

    task: Task
    fields: Mapping[str, Any]
    """The program by field."""
    warm_start: Vector | None = None
    """What every solve starts from; None for cold solves. Shape (d,)."""
    c: float = 1.0
    """The constant that the solver's ladder is made for."""
    times_itself: bool = False
    """Whether it is timed inside its compiled code."""

    @classmethod
    def of(cls, task: Task, form: Any, times_itself: bool = False) -> Self:
        """The request for a certified form, whose certificate and other windows stay with the parent."""
        start = form.warm_start if task.start == "warm" else None
        return cls(task, fields_of(form.qp), start, form.unit, times_itself)

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Run the task, at first once more to warm up; the same failures come again then."""

        def work() -> Outcome:
            solver = _waiting[self.task.key] = TimedSolver(cls, self)
            return solver.begin()

        _waiting.clear()
        if first:
            attempt(work)
        outcome = attempt(work)
        if outcome.failure and (lost := _waiting.pop(self.task.key, None)) is not None:
            outcome.mutated, outcome.asked = lost.were_inputs_changed(), lost.asked
        return outcome


@dataclass(frozen=True)
class Block(Request):
    """Update and solve once for each P (n, d, d) and q (n, d), timed, by the solver that is kept for the task of this
    key.

    After the call at which ``most_ns`` are spent no other begins.
    """

    key: str
    P: Matrix
    q: Matrix
    watch: bool
    most_ns: float

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Time them."""
        return replace(_waiting[self.key].block(self.P, self.q, self.most_ns), seen=seen() if self.watch else ())


@dataclass(frozen=True)
class End(Request):
    """Solve the first problem once more, say how the solver behaved, and forget it."""

    key: str
    budget_s: float

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Time some more set-ups, too, within the budget."""
        return replace(_waiting.pop(self.key).end(self.budget_s), seen=seen())


_waiting: dict[str, TimedSolver] = {}
"""The solver of this process that waits for data, by task."""


class TimedSolver:
    """A solver that is set up on the problem of a request, with data of its own for updates."""

    def __init__(self, cls: type[Solver], request: OneShot) -> None:
        self._cls, self._request, self._given = cls, request, Problem(**request.fields)
        # A solver that writes into one spoils neither the other nor ours.
        self._handed, self._updated = copied(self._given), copied(self._given)
        self._start = None if request.warm_start is None else request.warm_start.copy()
        self._time = time_kernel if request.times_itself else time_block
        self.asked = request.task.asked(cls, request.c)
        self.solver = cls(**self.asked)
        self._solve: Callable[[], Any] = (
            self.solver.solve if self._start is None else partial(self.solver.solve, self._start)
        )
        self._setups: list[int] = []
        self._spoiled = False

    def begin(self) -> Outcome:
        """Set up and solve the first problem, untimed but for the set-up."""
        self._setups.append(self.setup())
        found = self._solve()
        self._first = x = real(found)
        info = solver_info(self.solver.solution())
        if self._request.task.setting.rung_text:  # the iterate at the limit is the answer, whatever the solver reports
            if not np.isfinite(x).all() and (stood := self.solver.iterate()) is not None:
                x = real(stood)
            info["found"] |= bool(np.isfinite(x).all())
        return Outcome(
            x=x, asked=self.asked, returned="" if type(found) is np.ndarray else type(found).__name__, **info
        )

    def setup(self) -> int:
        """Nanoseconds of setting the solver up."""
        return time_call(partial(self.solver.setup, self._handed))

    def block(self, P: Matrix, q: Matrix, most_ns: float) -> Outcome:
        """Time a block; its data are as they were afterwards."""
        sums, before = (P.sum(), q.sum()), preemptions()
        timed = self._time(self.solver, P, q, self._start, most_ns)
        self._spoiled |= (P.sum(), q.sum()) != sums
        return Answered(
            found=True,
            preemptions=preemptions() - before,
            update_ns=timed.updates,
            solve_ns=timed.solves,
            answers=timed.answers,
        )

    def end(self, budget_s: float) -> Outcome:
        """Whether the first data give the first answer again, and whether inputs are as they were."""
        P = self._updated.P if isinstance(self._updated.P, np.ndarray) else self._updated.P.toarray()
        self.solver.update(P=P, q=self._updated.q)  # which takes dense data
        again = real(self._solve())
        changed = self.were_inputs_changed()
        for _ in range(2):
            if sum(self._setups) < budget_s * 1e9:
                self._setups.append(TimedSolver(self._cls, self._request).setup())
        return Outcome(
            found=True,
            repeatable=bool(np.array_equal(self._first, again, equal_nan=True)),
            mutated=changed,
            setup_ns=np.array(self._setups, dtype=np.int64),
        )

    def were_inputs_changed(self) -> bool:
        """Whether the solver wrote into what it was given."""
        pairs = [
            pair
            for taken in (self._handed, self._updated)
            for pair in zip(arrays(self._given), arrays(taken), strict=True)
        ]
        pairs += [] if self._start is None else [(self._request.warm_start, self._start)]
        return self._spoiled or any(not np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def preemptions() -> int:
    """How often this process was taken off its core so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_nivcsw


def arrays(problem: Problem) -> list[Any]:
    """Every array of a problem, those of sparse matrices too."""
    return [
        part
        for value in fields_of(problem).values()
        if value is not None
        for part in ([value] if isinstance(value, np.ndarray) else [value.data, value.indices, value.indptr])
    ]
