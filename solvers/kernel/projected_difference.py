"""The paper's solver: the projected difference equation.

    w(k+1) = Proj(w(k) − η (P w(k) + q)),    0 < η < 2/λ_max(P)

minimises ½ wᵀP w + qᵀw over a convex set that is easy to project onto. Source, proof and arithmetic stand in
:mod:`solvers.kernels.projected_step`. In slope coordinates the set is a box and the projection clips; in weight coordinates it
is a polyhedral cone and the projection is exact too (:mod:`solvers.kernels.cone_projection`). The two ways have one answer
and different paths. The paper runs 15 200 steps: one per sampling period of 125 µs for 1.9 s.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from qpsolvers import Problem, Solution

from solvers.kernels.cone_projection import Cone
from solvers.kernels.projected_step import Recursion, limit
from solvers.protocol import Lane, Matrix, Nanoseconds, Solver, Unsupported, Vector, box, dense


class ProjectedDifference(Solver):
    """Projected gradient with a fixed step, for bounds and for general rows G x ≤ h without equalities.

    A number of steps is asked for, not a tolerance, so every tier runs the same steps.

    Settings
    --------
    steps : int, default 15200
        Steps of one solve; the most where ``tolerance`` is set.
    step_ratio : float, default 0.5
        η λ_max/2, in (0, 1): the step as a part of the stability limit 2/λ_max; the default is η = 1/λ_max, which
        damps every direction without overshoot.
    allow_divergence : bool, default False
        Permit a step_ratio of 1 and more, which does not converge.
    diagonal_scaling : bool, default False
        Iterate in the variables w/D, D = diag(P)^−½, which keeps a box a box (in general rows G becomes G D).
    tolerance : float or None, default None
        Stop where the projected gradient |w(k+1) − w(k)|/η falls to this part of |q| (2-norms, looked at every 16
        steps). None, the paper's, looks at nothing.

    Examples
    --------
    >>> import numpy as np, qpsolvers
    >>> s = ProjectedDifference(steps=3)
    >>> s.setup(qpsolvers.Problem(np.diag([1.0, 2.0]), np.array([-1.0, 2.0]), lb=np.zeros(2)))
    >>> s.solve().tolist()
    [0.875, 0.0]
    """

    name: ClassVar[str] = "projected_difference"
    lane: ClassVar[Lane] = Lane.KERNEL
    algorithm: ClassVar[str] = "projected gradient"
    licence: ClassVar[str] = "MIT"
    distribution: ClassVar[str] = "piezobench"
    warm_startable: ClassVar[bool] = True
    iteration_setting: ClassVar[str | None] = "steps"
    variants: ClassVar[tuple[Mapping[str, Any], ...]] = tuple({"steps": steps} for steps in (1, 10, 100, 1000, 15200))

    def setup(self, problem: Problem) -> None:
        """Allocate, find the step and store P for it.

        Raises
        ------
        Unsupported
            The problem has equalities.
        ValueError
            A number is not finite where it must be, P is indefinite, the constraints are infeasible, or a setting is
            out of range.
        """
        if problem.A is not None:
            raise Unsupported(f"{self.name} takes bounds and inequalities, and the problem has equalities")
        settings = self.settings
        self._steps = int(settings.get("steps", 15200))
        self._ratio = float(settings.get("step_ratio", 0.5))
        self._tolerance = settings.get("tolerance")
        if self._steps < 0:
            raise ValueError(f"{self.name}: steps must not be negative, and it is {self._steps}")
        if not 0 < self._ratio < (np.inf if settings.get("allow_divergence", False) else 1):
            raise ValueError(f"{self.name}: step_ratio must lie between 0 and 1 (the stability limit), and it is "
                             f"{self._ratio}; allow_divergence=True permits more")
        self._lb, self._ub = box(problem)
        self._G = None if problem.G is None else np.asarray(problem.G.toarray() if hasattr(problem.G, "toarray") else problem.G)
        self._h = None if problem.h is None else np.asarray(problem.h, np.float64)
        self._taken = 0
        self._P, self._q = dense(problem)
        self._recursion: Recursion | None = None
        self.update(self._P, self._q)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Take new P (a new step follows from it) or q; raises ValueError as ``setup`` does."""
        if q is not None:
            if not np.isfinite(q).all():
                raise ValueError(f"{self.name}: q must be finite")
            np.copyto(self._q, q)
        scaling = bool(self.settings.get("diagonal_scaling", False))
        if P is not None:
            np.copyto(self._P, P)
            diagonal = self._P.diagonal()
            self._D = np.where(diagonal > 0, diagonal, 1.0) ** -0.5 if scaling else np.ones(self._q.size)
            scaled = self._P * self._D * self._D[:, None]
            eta = self._ratio * limit(scaled)
            self._eta = eta if np.isfinite(eta) else 1.0
            if self._recursion is None or scaling:
                self._cone = Cone(None if self._G is None else self._G * self._D, self._h, self._lb / self._D,
                                  self._ub / self._D)
                self._recursion = Recursion(self._q.size, self._cone)
            self._recursion.set_data(scaled, self._q * self._D, self._eta)
        elif self._recursion is not None:
            self._recursion.set_data(None, self._q * self._D, self._eta)
        self._threshold = -1.0
        if self._tolerance is not None:
            self._threshold = float(self._tolerance) * self._eta * float(np.linalg.norm(self._q * self._D))

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the last iterate, shape (d,); the first is the projection of ``warm_start``, or of 0."""
        recursion = self._recursion
        assert recursion is not None, "setup comes first"
        recursion.start(np.zeros(self._q.size) if warm_start is None else warm_start / self._D)
        self._taken = recursion.run(self._steps, self._threshold)
        return self._unscaled()

    @property
    def recursion(self) -> Recursion:
        """The recursion itself, for compiled loops that take its steps."""
        assert self._recursion is not None, "setup comes first"
        return self._recursion

    def begin(self, start: Vector) -> None:
        """Put the recursion at ``start`` (d,), to be moved on by ``advance`` as the machine runs."""
        self.recursion.start(start / self._D)

    def advance(self, steps: int) -> None:
        """Take so many steps from where the recursion stands."""
        self.recursion.run(steps)

    def answer(self) -> Vector:
        """Return the iterate (d,) where the recursion stands."""
        return self._unscaled()

    def time_kernel(self, count: int, warm_start: Vector | None = None) -> tuple[Nanoseconds | None, Nanoseconds]:
        """Run the steps from 0 or ``warm_start``, each time from there, timed; updates are not compiled."""
        assert self._recursion is not None, "setup comes first"
        self._recursion.start(np.zeros(self._q.size) if warm_start is None else warm_start / self._D)
        return None, self._recursion.time(count, self._steps, self._threshold)

    def time_rows(self, rows: Matrix, forgetting: float) -> tuple[Matrix, Nanoseconds]:
        """Take rows one after the other, ``steps`` steps after each from where the last ones ended; all is timed but the data."""
        assert self._recursion is not None, "setup comes first"
        if self.settings.get("diagonal_scaling", False) or self._tolerance is not None:
            raise Unsupported(f"{self.name} follows rows without diagonal scaling and tolerance only")
        return self._recursion.follow(self._P, self._q, np.ascontiguousarray(rows, dtype=np.float64), forgetting,
                                      self._ratio, self._steps)

    def solution(self) -> Solution:
        """Return the last iterate with the duals of its last projection; ``extras`` say steps and step size."""
        assert self._recursion is not None, "setup comes first"
        w, x = self._recursion.w.copy(), self._unscaled()
        gradient = self._P @ x + self._q
        problem = Problem(self._P, self._q, self._G, self._h, lb=self._lb, ub=self._ub)
        z, z_box = self._cone.multipliers(w, gradient * self._D, self._eta)
        return Solution(problem, found=bool(np.isfinite(x).all()), x=x, y=np.zeros(0), z=z, z_box=z_box / self._D,
                        obj=float(0.5 * x @ (gradient + self._q)), extras={"steps": self._taken, "eta": self._eta})

    def _unscaled(self) -> Vector:
        """The last iterate in the caller's variables; scaling back can leave a bound by one bit, clipping undoes that."""
        assert self._recursion is not None, "setup comes first"
        return np.minimum(np.maximum(self._recursion.w * self._D, self._lb), self._ub)
