"""The child's side of the stream race; the parent's side is in `race`.

Every solver runs on the absolute schedule of `bench.timing.schedule`. Before each sample the child updates P and q
while it waits for the due time; no solver's service time contains that. At the due time the solver gets P and q by
``update`` and solves, warm from the previous answer if it can.
"""

import gc
from dataclasses import dataclass

import numpy as np
from qpsolvers import Problem

from bench.messages.task import Outcome, Request, Task
from bench.problem_files.program import copied
from bench.timing.clock import no_garbage_collection
from bench.timing.schedule import Timeline, follow
from solvers.forgetting import absorb
from solvers.protocol import Matrix, Solver, Vector

WARM_UP = 800
"""Number of samples of the same stream that another solver object processes first, untimed."""


@dataclass(kw_only=True)
class Streamed(Outcome):
    """Times and answers of a stream: the answer (d,) of each solve, NaN for none."""

    timeline: Timeline


@dataclass(frozen=True)
class StreamRequest(Request):
    """Follow a stream."""

    task: Task
    start: Problem
    """The program before the first row."""
    c: float
    """Its constant."""
    x: Vector
    """The answer in use before the first solve; every solver may start from it. Shape (d,)."""
    rows: Matrix
    """Shape (N, d + 1)."""
    forgetting: float
    give_up: int
    """See :func:`bench.timing.schedule.follow`."""

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Warm up, then run."""
        self._run(cls, min(WARM_UP, len(self.rows)))
        gc.collect()
        return self._run(cls, len(self.rows))

    def _run(self, cls: type[Solver], samples: int) -> Outcome:
        """All memory is allocated beforehand. The answer is copied inside its time, so that a lazy result is computed
        there; the next solve starts from it if it is finite."""
        solver, start = cls(**self.task.settings_for(cls, self.c)), self.start
        solver.setup(copied(start))
        P, q, previous, x = start.P.copy(), start.q.copy(), self.x.copy(), self.x.copy()
        answers, warm = np.full((samples, x.size), np.nan), [previous] if cls.warm_startable else []

        def solve() -> None:
            x[:] = solver.solve(*warm)

        def keep(j: int) -> None:
            answers[j] = x
            if np.isfinite(x).all():
                previous[:] = x

        with no_garbage_collection():
            t = follow(
                samples,
                lambda first, last: self._absorb(P, q, first, last),
                lambda first, last: solver.update(P, q),
                solve,
                keep,
                give_up=self.give_up,
            )
        same_P, same_q = start.P.copy(), start.q.copy()
        self._absorb(same_P, same_q, 0, t.samples - 1)
        return Streamed(
            found=True,
            settings=self.task.settings_for(cls, self.c),
            timeline=t,
            answers=answers[: t.solved.size],
            times={
                "service": t.service_ns,
                "response": t.response_ns,
                "data": t.data_ns,
                "update": t.updated - t.began,
                "sample": t.solved,
                "began": t.began,
            },
            mutated=not (np.array_equal(P, same_P) and np.array_equal(q, same_q)),
        )

    def _absorb(self, P: Matrix, q: Vector, first: int, last: int) -> None:
        """Update P and q with the samples ``first`` to ``last``."""
        absorb(P, q, np.zeros(1), self.rows, first, last + 1, self.forgetting)
