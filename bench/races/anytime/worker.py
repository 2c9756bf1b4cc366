"""The child's side of the anytime race: one solver on one problem with a growing limit of iterations.

Each limit gets a solver object of its own, which answers from a cold start; where the limit ended the solve, the answer is
the iterate there. Update and solve are timed together at each limit as in the one-shot race. The limits grow until the
solver is done before it meets one, the iterate stays the same to the last bit, or the next limit would by the growth of
the last ones take longer than ``longest_s``. A solver without such a limit has a single point.
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
from bench.timing.clock import Effort, Timed, time_block, time_kernel
from solvers.arrays import Vector
from solvers.protocol import Nanoseconds, Solver, dense

NO_LIMIT = -1


@dataclass(frozen=True)
class Point:
    """One limit: the answer, what the solver says of it, and the raw times."""

    limit: int
    x: Vector
    found: bool
    status: str
    iterations: int
    update_ns: Nanoseconds
    solve_ns: Nanoseconds


@dataclass
class Curve(Outcome):
    """What came back: points by growing limit, and the name of the setting, "" where the solver has none."""

    points: list[Point] = field(default_factory=list)
    iteration_setting: str = ""


@dataclass(frozen=True)
class AnytimeRequest(Request):
    """Run a solver on one problem with each of the limits, ascending."""

    task: Task
    fields: Mapping[str, Any]
    c: float
    effort: Effort
    limits: tuple[int, ...]
    longest_s: float
    times_itself: bool
    """Whether it is timed inside its compiled code."""

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Warm up on the first limit if need be, then go through them."""
        def work() -> Outcome:
            limits = self.limits if cls.iteration_setting else (NO_LIMIT,)
            if first:
                self._point(cls, limits[0], Effort(0.0, 1, 1))
            return Curve(found=True, points=self._points(cls, limits), asked=self.task.asked(cls, self.c),
                         iteration_setting=cls.iteration_setting or "")

        return attempt(work)

    def _points(self, cls: type[Solver], limits: tuple[int, ...]) -> list[Point]:
        points: list[Point] = []
        for limit in limits:
            if points:
                last = points[-1]
                seconds = 1e-9 * float(np.median(last.update_ns) + np.median(last.solve_ns))
                if seconds * limit / last.limit > self.longest_s:
                    break
            points.append(self._point(cls, limit, self.effort))
            done = points[-1].found and points[-1].iterations != limit
            if done or (len(points) > 1 and np.array_equal(points[-1].x, points[-2].x)):
                break
        return points

    def _point(self, cls: type[Solver], limit: int, effort: Effort) -> Point:
        setting = {} if limit == NO_LIMIT else {str(cls.iteration_setting): limit}
        solver, problem = cls(**{**self.task.asked(cls, self.c), **setting}), Problem(**self.fields)
        solver.setup(problem)
        x = real(solver.solve())
        if not np.isfinite(x).all() and (stood := solver.iterate()) is not None:
            x = real(stood)
        said = Said.of(solver.solution())
        time_one = time_kernel if self.times_itself else time_block
        P, q = dense(problem)
        times: list[Timed] = []
        spent = 0
        while effort.goes_on(len(times), spent):
            times.append(time_one(solver, P[None], q[None]))
            spent += int(times[-1].updates[0] + times[-1].solves[0])
        return Point(limit, x, said.found, said.status, said.iterations, np.concatenate([each.updates for each in times]),
                     np.concatenate([each.solves for each in times]))
