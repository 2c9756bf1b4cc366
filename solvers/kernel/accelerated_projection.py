"""Nesterov's accelerated projected gradient with adaptive restart, for problems with bounds only.

    w(k+1) = clip(y(k) − η (P y(k) + q)),    y(k+1) = w(k+1) + β(k) (w(k+1) − w(k)),    η = 1/λ_max

in the variables w = D⁻¹ x with D = diag(P)^−½. Sources and the restart rule stand in
``solvers/core/acceleration.c``. It is the paper's recursion with two vectors more in memory, and takes the square
root of its number of steps.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from qpsolvers import Problem, Solution

from solvers.core import bindings
from solvers.descent import ProjectedGradient
from solvers.ours import Ours
from solvers.protocol import Lane, Matrix, Solver, Timings, Vector, box_solution, dense, only_box


class AcceleratedProjection(Ours, Solver):
    """Accelerated projected gradient.

    Settings
    --------
    tolerance : float, default 1e-13
        Stop where the projected gradient falls to this part of max(|q|, |P w(0) + q|), 2-norms in the scaled variables.
    steps : int, default 100000
        The most steps of one solve.
    diagonal_scaling : bool, default True
        Scale the variables to a unit diagonal of P.

    Examples
    --------
    >>> import numpy as np, qpsolvers
    >>> s = AcceleratedProjection()
    >>> s.setup(qpsolvers.Problem(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([1.0, -4.0]), lb=np.zeros(2)))
    >>> s.solve().round(12).tolist()
    [0.0, 2.0]
    """

    name: ClassVar[str] = "accelerated_projection"
    lane: ClassVar[Lane] = Lane.KERNEL
    algorithm: ClassVar[str] = "accelerated projected gradient"
    warm_startable: ClassVar[bool] = True
    iteration_setting: ClassVar[str | None] = "steps"
    always: ClassVar[Mapping[str, Any]] = MappingProxyType({"tolerance": 1e-13})

    @classmethod
    def ladder(cls, c: float) -> tuple[Mapping[str, Any], ...]:
        """Tolerances, which are relative to the gradient at the start."""
        return tuple({"tolerance": 10.0**-k} for k in (3, 4, 5, 6, 8, 10, 12, 13))

    def setup(self, problem: Problem) -> None:
        """Allocate, scale and find the step.

        Raises
        ------
        Unsupported
            The problem has general rows.
        ValueError
            A number is NaN or infinite where it may not be, P is not symmetric or indefinite beyond rounding, or bounds
            cross.
        """
        self._lb, self._ub = only_box(problem, self.name)
        self._tolerance, self._steps = float(self.settings["tolerance"]), int(self.settings.get("steps", 100_000))
        self._scaled = bool(self.settings.get("diagonal_scaling", True))
        self._P, self._q = dense(problem)
        self._method = ProjectedGradient(self._lb, self._ub, self.name)
        self.update(self._P, self._q)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Take new P (a new step follows from it) or q; raises ValueError as ``setup`` does."""
        if P is not None:
            np.copyto(self._P, P)
        if q is not None:
            np.copyto(self._q, q)
        self._method.take(None if P is None else self._P, None if q is None else self._q, 0.5, self._scaled)

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the last iterate, shape (d,); the first is ``warm_start``, or 0, clipped."""
        self._method.start(warm_start)
        bindings.accelerated_steps(self._method.state, self._steps, self._tolerance)
        return self._method.answer()

    def time_kernel(self, P: Matrix, q: Matrix, warm_start: Vector | None = None, most_ns: float = np.inf) -> Timings:
        """Take each P and q and run the steps from 0 or ``warm_start``, timed."""
        timings = self._method.time(
            bindings.time_accelerated, self._steps, self._tolerance, 0.5, self._scaled, P, q, warm_start, most_ns
        )
        last = timings[0].size - 1
        self._P[:], self._q[:] = P[last], q[last]
        return timings

    def solution(self) -> Solution:
        """Return the last iterate; found says whether it met the tolerance within the steps."""
        return box_solution(
            Problem(self._P, self._q, lb=self._lb, ub=self._ub),
            self._method.answer(),
            self._method.met,
            steps=self._method.taken,
        )
