"""The arrays of the projected recursion for compiled loops that take its steps themselves, until those loops are in C as it is.

The solver that the registry knows is ``solvers.kernel.projected_difference``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from qpsolvers import Problem

from solvers.kernels.cone_projection import Cone
from solvers.kernels.projected_step import Recursion, limit
from solvers.protocol import Matrix, Unsupported, Vector, box, dense


class ProjectedEngine:
    """What cyclic learning steps through: arrays of :mod:`solvers.kernels.projected_step`."""

    name = "projected_difference"

    def __init__(self, **settings: Any) -> None:
        self.settings = settings

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

    def _unscaled(self) -> Vector:
        """The last iterate in the caller's variables; scaling back can leave a bound by one bit, clipping undoes that."""
        assert self._recursion is not None, "setup comes first"
        return np.minimum(np.maximum(self._recursion.w * self._D, self._lb), self._ub)
