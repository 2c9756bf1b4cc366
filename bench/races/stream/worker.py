"""The child's side of the stream race; the parent's side is in `race`.

Solvers of the lane direct and of the modelling lanes run on the absolute schedule of `bench.timing.schedule`. Before
each sample the child updates P and q while it waits for the due time; no solver's service time contains that. At the
due time the solver gets P and q by ``update`` and solves, warm from the previous answer if it can.

The kernel lane of this package has no schedule: a compiled loop takes the rows back to back and records the time of
each, including the copy of the answer, without Python and without waiting. A user's kernel solver is timed from
outside, on the schedule. When the rows are used up the loop goes through them backwards and forwards again, which makes
no jump, until ``kernel_samples`` are done or KERNEL_WALL_S are spent, checked after every KERNEL_BLOCK rows.
"""

import gc
import time
from dataclasses import dataclass

import numpy as np
from qpsolvers import Problem

from bench.messages.task import Outcome, Request, Task
from bench.problem_files.program import copied
from bench.timing.clock import no_garbage_collection
from bench.timing.schedule import Timeline, follow
from solvers.forgetting import absorb
from solvers.protocol import Matrix, Nanoseconds, Solver, Vector

WARM_UP = 800
"""Number of samples of the same stream that another solver object processes first, untimed."""
KERNEL_WALL_S = 10.0
"""Longest run of a compiled loop."""
KERNEL_BLOCK = 2_000
"""Rows per call of a compiled loop."""


@dataclass
class Streamed(Outcome):
    """Times and answers of a stream: the answer (d,) of each solve, NaN for none; of a compiled loop those of the first
    pass, and service times alone, one for each row."""

    timeline: Timeline | None = None
    """Timeline of a run on the schedule; None for a compiled loop."""


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
    kernel_samples: int
    """Number of rows for a compiled loop; 0 for a run on the schedule."""
    give_up: int
    """See :func:`bench.timing.schedule.follow`."""

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Warm up, then run."""
        run, samples = (self._compiled, self.kernel_samples) if self.kernel_samples else (self._paced, len(self.rows))
        run(cls, min(WARM_UP, samples))
        gc.collect()
        return run(cls, samples)

    def _set_up(self, cls: type[Solver]) -> Solver:
        """A new solver, set up with its own copy of the start."""
        solver = cls(**self.task.settings_for(cls, self.c))
        solver.setup(copied(self.start))
        return solver

    def _paced(self, cls: type[Solver], samples: int) -> Outcome:
        """All memory is allocated beforehand. The answer is copied inside its time, so that a lazy result is computed
        there; the next solve starts from it if it is finite."""
        solver, start = self._set_up(cls), self.start
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

    def _compiled(self, cls: type[Solver], samples: int) -> Outcome:
        solver = self._set_up(cls)
        if cls.warm_startable:
            solver.solve(self.x)
        answers: list[Matrix] = []
        times: list[Nanoseconds] = []
        done, began = 0, time.monotonic()
        with no_garbage_collection():
            while done < samples and (not times or time.monotonic() - began < KERNEL_WALL_S):
                passes, at = divmod(done, len(self.rows))
                rows = self.rows[::-1] if passes % 2 else self.rows
                block = rows[at : at + min(KERNEL_BLOCK, samples - done)]
                x, nanoseconds = solver.time_rows(np.ascontiguousarray(block), self.forgetting)
                if passes == 0:
                    answers.append(x)
                times.append(nanoseconds)
                done += nanoseconds.size
        return Streamed(
            found=True,
            settings=self.task.settings_for(cls, self.c),
            answers=np.concatenate(answers),
            times={"service": np.concatenate(times)},
        )
