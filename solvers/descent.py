"""Projected gradient methods in C, see ``solvers/core/descent.h``."""

from collections.abc import Callable
from functools import partial
from typing import ClassVar

import numpy as np
from qpsolvers import Problem, Solution

from solvers.core import NOT_FINITE, bindings, block, parts
from solvers.ours import OurSolver
from solvers.protocol import Matrix, Timings, Vector, box_solution, dense, only_box
from solvers.timed_calls import time_calls


class ProjectedGradient(OurSolver):
    """A method for problems with bounds only, in the variables w = x/D; D is 1 or diag(P)^−½, with which a box stays a
    box."""

    warm_startable = True
    iteration_setting = "steps"
    take_steps: ClassVar[Callable[..., int]]
    """The compiled steps."""
    timed_loop: ClassVar[Callable[..., int]]
    """The compiled loop that times ``update`` and ``solve``."""
    _steps: int
    _tolerance: float
    _scaled: bool
    _ratio: float = 0.5
    """η λ_max/2."""

    def setup(self, problem: Problem) -> None:
        """Allocate, scale and compute the step size.

        Raises
        ------
        Unsupported
            The problem has general rows.
        ValueError
            A number is NaN or infinite where it may not be, P is not symmetric or indefinite beyond rounding, bounds
            cross, or a setting is out of range.
        """
        self._lb, self._ub = only_box(problem, self.name)
        self._P, self._q = dense(problem)
        self.state = block(bindings.descent_bytes(self._q.size))
        self.accept(bindings.descent_setup(self.state, self._lb, self._ub))
        self._parts = parts(self.state, bindings.descent_places(self.state))
        self.update(self._P, self._q)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Take new P (with a new step size) or q; raises ValueError as ``setup`` does."""
        if P is not None:
            np.copyto(self._P, P)
            P = self._P
        if q is not None:
            np.copyto(self._q, q)
            q = self._q
        status = bindings.descent_set_data(self.state, P, q, self._ratio, int(self._scaled))
        if status == NOT_FINITE:
            raise ValueError(f"{self.name}: {'q' if P is None or np.isfinite(P).all() else 'P'} must be finite")
        self.accept(status)

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the last iterate, shape (d,); the first is the projection of ``warm_start``, or of 0."""
        start = None if warm_start is None else np.ascontiguousarray(warm_start, dtype=np.float64)
        bindings.descent_start(self.state, start)
        type(self).take_steps(self.state, self._steps, self._tolerance)
        return self._last_iterate()

    def time_kernel(self, P: Matrix, q: Matrix, warm_start: Vector | None = None, most_ns: float = np.inf) -> Timings:
        """Take each P and q and run the steps from the projection of ``warm_start``, or of 0, timed."""
        loop = partial(type(self).timed_loop, self.state, self._ratio, int(self._scaled), self._steps, self._tolerance)
        status, timings = time_calls(loop, P, q, warm_start, most_ns)
        self.accept(status)
        last = timings[0].size - 1
        self._P[:], self._q[:] = P[last], q[last]
        return timings

    def _last_iterate(self) -> Vector:
        """x (d,); exactly at a bound if the scaled iterate w is."""
        bindings.descent_answer(self.state)
        return self.part("answer").copy()

    def found(self, x: Vector) -> bool:
        """Whether the last run ended by its tolerance."""
        return bool(self.part("met").view(np.int32)[0])

    def solution(self) -> Solution:
        """Return the last iterate; ``extras`` has the number of steps and the step size."""
        x, steps = self._last_iterate(), self.part("taken").view(np.int64)[0]
        problem = Problem(self._P, self._q, lb=self._lb, ub=self._ub)
        return box_solution(problem, x, self.found(x), steps=int(steps), eta=float(self.part("eta")[0]))
