"""Nesterov's accelerated projected gradient with adaptive restart, for problems with bounds only.

    w(k+1) = clip(y(k) − η (P y(k) + q)),    y(k+1) = w(k+1) + β(k) (w(k+1) − w(k)),    η = 1/λ_max

in the variables w = D⁻¹ x with D = diag(P)^−½. Sources and the restart rule stand in
:mod:`solvers.kernels.accelerated_step`. It is the paper's recursion with two vectors more in memory, and takes the square
root of its number of steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from qpsolvers import Problem, Solution

from solvers.kernels.accelerated_step import Acceleration
from solvers.kernels.projected_step import limit
from solvers.protocol import Lane, Matrix, Nanoseconds, Solver, Tier, Vector, box_solution, dense, only_box


class AcceleratedProjection(Solver):
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
    licence: ClassVar[str] = "MIT"
    distribution: ClassVar[str] = "piezobench"
    warm_startable: ClassVar[bool] = True
    iteration_setting: ClassVar[str | None] = "steps"
    tiers: ClassVar[Mapping[Tier, Mapping[str, Any]]] = {
        tier: {"tolerance": tier.tolerance} for tier in (Tier.LOW, Tier.MID, Tier.HIGH)
    }

    def setup(self, problem: Problem) -> None:
        """Allocate, scale and find the step; raises Unsupported for general rows and ValueError for unusable numbers."""
        self._lb, self._ub = only_box(problem, self.name)
        if not ((self._lb <= self._ub) & (self._lb < np.inf) & (self._ub > -np.inf)).all():
            raise ValueError(f"{self.name}: a bound is NaN, or a lower bound lies above its upper bound or at +inf")
        self._tolerance, self._steps = float(self.settings.get("tolerance", 1e-13)), int(self.settings.get("steps", 100_000))
        self._P, self._q = dense(problem)
        self._taken = 0
        self._method = Acceleration(self._q.size)
        self.update(self._P, self._q)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Take new P (a new step follows from it) or q; raises ValueError where they are not finite or P is indefinite."""
        if q is not None:
            if not np.isfinite(q).all():
                raise ValueError(f"{self.name}: q must be finite")
            np.copyto(self._q, q)
        scaled = None
        if P is not None:
            np.copyto(self._P, P)
            diagonal, scaling = self._P.diagonal(), self.settings.get("diagonal_scaling", True)
            self._D = np.where(diagonal > 0, diagonal, 1.0) ** -0.5 if scaling else np.ones(self._q.size)
            scaled = self._P * self._D * self._D[:, None]
            eta = 0.5 * limit(scaled)
            self._eta = eta if np.isfinite(eta) else 1.0
            self._method.set_bounds(self._lb / self._D, self._ub / self._D)
        self._method.set_data(scaled, self._q * self._D, self._eta)

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the last iterate, shape (d,); the first is ``warm_start``, or 0, clipped."""
        self._method.start(np.zeros(self._q.size) if warm_start is None else warm_start / self._D)
        self._taken = self._method.run(self._steps, self._tolerance)
        # Scaling back can leave a bound by one bit; clipping undoes that.
        return np.clip(self._method.w * self._D, self._lb, self._ub)

    def time_kernel(self, count: int, warm_start: Vector | None = None) -> tuple[Nanoseconds | None, Nanoseconds]:
        """Run the steps from 0 or ``warm_start``, each time from there, timed; updates are not compiled."""
        self._method.start(np.zeros(self._q.size) if warm_start is None else warm_start / self._D)
        return None, self._method.time(count, self._steps, self._tolerance)

    def solution(self) -> Solution:
        """Return the last iterate; found says whether it met the tolerance within the steps."""
        x = np.clip(self._method.w * self._D, self._lb, self._ub)
        return box_solution(Problem(self._P, self._q, lb=self._lb, ub=self._ub), x, self._taken < self._steps,
                            steps=self._taken)
