"""Solvers of SciPy that are one function call on a problem with bounds only, without duals.

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub

Those of linear least squares take the Cholesky factor of P, which ``setup`` and ``update`` compute:

    ½ xᵀP x + qᵀx = ½ ‖Lᵀx + L⁻¹q‖² + constant   with   P = L Lᵀ

Lawson, Hanson, Solving Least Squares Problems, 1974, chapter 23. Files of this folder that begin with an underscore are
shared parts, not solvers.
"""

from abc import abstractmethod
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from solvers.adapter import LibrarySolver, Matrix, Program, Report, Unsupported, Vector
from solvers.protocol import box_duals

BoxResult = tuple[Vector, bool, str, int | None]
"""x, whether the library calls it found, its status and its number of iterations."""


class BoxMinimiser(LibrarySolver):
    """A solver of problems with bounds only; a subclass defines ``minimise``."""

    bounds_only = True

    @abstractmethod
    def minimise(self, start: Vector | None) -> BoxResult:
        """Call the library."""

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._result = self.minimise(warm_start)
        return self._result[0]

    def cost(self, x: Vector) -> tuple[float, Vector]:
        """½ xᵀP x + qᵀx and its gradient P x + q, shape (d,)."""
        Px = self.program.P @ x
        return float(0.5 * x @ Px + self.program.q @ x), Px + self.program.q

    def report(self) -> Report:
        x, found, status, iterations = self._result
        return Report(found, box_duals(self.cost(x)[1], self.program.lb, self.program.ub, x), status, iterations)


class LeastSquares(BoxMinimiser):
    """A solver of minimise ‖Lᵀx − right‖ with bounds."""

    L: Matrix

    def build(self, p: Program, rows: Any) -> None:
        self.pass_data(p.P, p.q)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        try:
            self.L = self.L if P is None else np.linalg.cholesky(P).astype(np.float64, copy=False)
        except np.linalg.LinAlgError:
            message = f"{self.name} needs a positive definite P, and P has no Cholesky factor"
            raise Unsupported(message) from None

    def right(self, linear: Vector) -> Vector:
        """−L⁻¹ times a linear cost, shape (d,)."""
        return solve_triangular(self.L, -linear, lower=True, check_finite=False)
