"""The child's side of the anytime race: one solver on one problem with one limit of iterations.

Each limit gets a solver object of its own, which answers from a cold start; where the limit ended the solve, the answer is
the iterate there. Update and solve are timed together as in the one-shot race, on data of the problem's kind that the parent makes for
this limit and the solver has not seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from qpsolvers import Problem

from bench.passed.outcome import Outcome
from bench.passed.request import Request, attempt
from bench.passed.said import Said, real
from bench.passed.task import Task
from bench.timing.clock import LONG_NS, Effort, Timed, time_block, time_kernel
from solvers.arrays import Matrix, Vector
from solvers.protocol import Solver, dense

NO_LIMIT = -1


@dataclass
class Point(Outcome):
    """One limit, NO_LIMIT where the solver has none: the answer, what the solver says of it, and the raw times."""

    x: Vector = field(default_factory=lambda: np.zeros(0))
    limit: int = NO_LIMIT
    iteration_setting: str = ""
    """Name of the setting, "" where the solver has none."""


@dataclass(frozen=True)
class PointRequest(Request):
    """Solve one problem with one limit, and time the data P (n, d, d) and q (n, d)."""

    task: Task
    fields: Mapping[str, Any]
    c: float
    effort: Effort
    limit: int
    P: Matrix
    q: Matrix
    times_itself: bool
    """Whether it is timed inside its compiled code."""

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Warm up on the problem itself if need be."""
        def work() -> Outcome:
            if first:
                P, q = dense(Problem(**self.fields))
                self._point(cls, P[None], q[None])
            return self._point(cls, self.P, self.q)

        return attempt(work)

    def _point(self, cls: type[Solver], P: Matrix, q: Matrix) -> Point:
        name, asked = cls.iteration_setting or "", self.task.asked(cls, self.c)
        solver = cls(**{**asked, name: self.limit} if name else asked)
        solver.setup(Problem(**self.fields))
        x = real(solver.solve())
        if not np.isfinite(x).all() and (stood := solver.iterate()) is not None:
            x = real(stood)
        said = Said.of(solver.solution())
        timed = self._timed(solver, P, q)
        return Point(found=said.found, x=x, solver_status=said.status, iterations=said.iterations, asked=asked,
                     update_ns=np.concatenate([each.updates for each in timed]), solve_ns=np.concatenate([each.solves for each in timed]),
                     limit=self.limit if name else NO_LIMIT, iteration_setting=name)

    def _timed(self, solver: Solver, P: Matrix, q: Matrix) -> list[Timed]:
        """The fewest calls, then those that the budget allows."""
        time_them = time_kernel if self.times_itself else time_block
        parts: list[Timed] = []
        done = spent = 0
        while done < len(q) and self.effort.goes_on(done, spent):
            end, most_ns = (self.effort.fewest, LONG_NS) if done < self.effort.fewest else (self.effort.most, self.effort.budget_s * 1e9)
            parts.append(time_them(solver, P[done:end], q[done:end], None, most_ns - spent))
            done += parts[-1].solves.size
            spent += int(parts[-1].updates.sum() + parts[-1].solves.sum())
        return parts
