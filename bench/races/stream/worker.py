"""The child's side of the stream race; the parent's is in `race`.

Lane direct and the modelling lanes run on the absolute schedule of `schedule`. Each sample the child brings P and q up
to date, which is the machine's common work: it is done while waiting for the due time and is in nobody's service time.
At the due time the solver gets P and q by ``update`` and answers, warm from the previous answer where it can; a solver
that takes rows gets the row by ``append`` in place of P and q, and following the data is then its own work and timed.

The solvers of this package's kernel lane have no schedule: a compiled loop takes the rows back to back and notes what
each took, the copy of the answer included, service times that no Python and no waiting is in; a user's solver is timed
from outside, on the schedule. When the rows are through the loop goes back along them and forth again, which has no
jump, until ``kernel_samples`` are done or, looked at after every KERNEL_BLOCK rows, KERNEL_WALL_S are spent.
"""

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from qpsolvers import Problem

from bench.messages.task import Outcome, Request, Task
from bench.problem_files.program import copied
from bench.timing.clock import no_garbage_collection
from bench.timing.schedule import PERIOD_NS, Timeline, follow
from solvers.arrays import Matrix, Nanoseconds, Vector
from solvers.forgetting import absorb
from solvers.protocol import Solver

WARM_UP = 800
"""Samples of the same sequence, taken alike, with a solver object of their own and not counted."""
KERNEL_WALL_S = 10.0
KERNEL_BLOCK = 2_000


@dataclass
class Streamed(Outcome):
    """What came back from a stream."""

    timeline: Timeline | None = None
    """On the schedule; None of a compiled loop."""
    answers: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    """Of each solve, NaN where it gave none; in a compiled loop of the first way along the rows. Shape (M, d)."""
    kernel_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """What each row took in a compiled loop. Shape (K,)."""

    @property
    def times(self) -> Mapping[str, Nanoseconds]:
        """Of a compiled loop the service times alone."""
        if (t := self.timeline) is None:
            return {"service": self.kernel_ns}
        return {
            "service": t.service_ns,
            "response": t.response_ns,
            "data": t.data_ns,
            "update": t.updated - t.began,
            "sample": t.solved,
            "began": t.began,
        }


@dataclass(frozen=True)
class StreamRequest(Request):
    """Follow a stream."""

    task: Task
    fields: Mapping[str, Any]
    """The start's program by field."""
    c: float
    start: Vector
    """What is in use before the first answer; every solver may start from it. Shape (d,)."""
    rows: Matrix
    """Shape (N, d + 1)."""
    forgetting: float
    kernel_samples: int
    """The most rows in its compiled loop; 0 where it is timed from outside, on the schedule."""
    give_up: int
    """As of :func:`bench.timing.schedule.follow`."""
    period_ns: int = PERIOD_NS

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Warm up, then run."""
        work, most = (self._compiled, self.kernel_samples) if self.kernel_samples else (self._paced, len(self.rows))
        work(cls, min(WARM_UP, most))
        gc.collect()
        return work(cls, most)

    def _ready(self, cls: type[Solver]) -> Solver:
        """A solver set up with the start, untouched by what another one does to its arrays."""
        forgetting = {"forgetting": self.forgetting} if cls.takes_rows else {}
        solver = cls(**self.task.settings_for(cls, self.c), **forgetting)
        solver.setup(copied(Problem(**self.fields)))
        return solver

    def _paced(self, cls: type[Solver], samples: int) -> Outcome:
        run = PacedRun(self._ready(cls), self, samples)
        with no_garbage_collection():
            timeline = follow(
                samples, run.absorb, run.update, run.solve, run.keep, period_ns=self.period_ns, give_up=self.give_up
            )
        return Streamed(
            found=True,
            settings=self.task.settings_for(cls, self.c),
            timeline=timeline,
            answers=run.answers[: timeline.solved.size],
            mutated=run.were_data_changed(timeline.samples),
        )

    def _compiled(self, cls: type[Solver], samples: int) -> Outcome:
        solver = self._ready(cls)
        if cls.warm_startable:
            solver.solve(self.start)
        answers: list[Matrix] = []
        taken: list[Nanoseconds] = []
        done, began = 0, time.monotonic()
        with no_garbage_collection():
            while done < samples and (not taken or time.monotonic() - began < KERNEL_WALL_S):
                way, at = divmod(done, len(self.rows))
                block = (self.rows[::-1] if way % 2 else self.rows)[at : at + min(KERNEL_BLOCK, samples - done)]
                found, nanoseconds = solver.time_rows(np.ascontiguousarray(block), self.forgetting)
                if way == 0:
                    answers.append(found)
                taken.append(nanoseconds)
                done += nanoseconds.size
        return Streamed(
            found=True,
            settings=self.task.settings_for(cls, self.c),
            answers=np.concatenate(answers),
            kernel_ns=np.concatenate(taken),
        )


class PacedRun:
    """What is done at each sample on the schedule, by a solver set up with the start, with everything allocated before
    it begins.

    An answer is copied inside its time: what is computed only when it becomes an array is computed there.
    """

    def __init__(self, solver: Solver, request: StreamRequest, samples: int) -> None:
        self._solver, self._request = solver, request
        self._P, self._q, self._c = self._data()
        self._previous = request.start.copy()
        self.answers = np.full((samples, self._previous.size), np.nan)
        self._parts = [(row[:-1], float(row[-1])) for row in request.rows[:samples]] if solver.takes_rows else []
        self.update: Callable[[int, int], None] = self._append if solver.takes_rows else self._update
        self.solve: Callable[[], None] = self._solve_warm if solver.warm_startable else self._solve_cold
        self._x = self._previous.copy()

    def _data(self) -> tuple[Matrix, Vector, Vector]:
        fields = self._request.fields
        return fields["P"].copy(), fields["q"].copy(), np.zeros(1)

    def absorb(self, first: int, last: int) -> None:
        """Bring P and q up to the sample ``last``; nothing where the solver does that itself."""
        if not self._solver.takes_rows:
            absorb(self._P, self._q, self._c, self._request.rows, first, last + 1, self._request.forgetting)

    def _update(self, first: int, last: int) -> None:
        self._solver.update(self._P, self._q)

    def _append(self, first: int, last: int) -> None:
        for row, target in self._parts[first : last + 1]:
            self._solver.append(row, target)

    def _solve_warm(self) -> None:
        self._x[:] = self._solver.solve(self._previous)

    def _solve_cold(self) -> None:
        self._x[:] = self._solver.solve()

    def keep(self, j: int) -> None:
        """Put the answer of solve j away; one that is none leaves the previous answer to start from."""
        self.answers[j] = self._x
        if np.isfinite(self.answers[j]).all():
            self._previous = self.answers[j]

    def were_data_changed(self, samples: int) -> bool:
        """Whether the solver wrote into the P and q that it was handed: the same rows again must give the same bits."""
        if self._solver.takes_rows:
            return False
        P, q, c = self._data()
        absorb(P, q, c, self._request.rows, 0, samples, self._request.forgetting)
        return not (np.array_equal(P, self._P) and np.array_equal(q, self._q))
