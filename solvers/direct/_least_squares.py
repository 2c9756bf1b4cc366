"""Quadratic programs with bounds as linear least squares on the Cholesky factor of P.

    ½ xᵀP x + qᵀx = ½ ‖Lᵀx + L⁻¹q‖² + constant   with   P = L Lᵀ

Lawson, Hanson, Solving Least Squares Problems, 1974, chapter 23. ``setup`` and ``update`` factorise.
"""

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from solvers.adapter import Matrix, Program, Stack, Unsupported, Vector
from solvers.direct._box import BoxMinimiser, BoxResult


def cholesky(P: Matrix, name: str) -> Matrix:
    """L of P = L Lᵀ, lower triangular (d, d), or :class:`Unsupported` for a P that is not positive definite."""
    try:
        return np.linalg.cholesky(P).astype(np.float64, copy=False)
    except np.linalg.LinAlgError:
        raise Unsupported(f"{name} needs a positive definite P, and P has no Cholesky factor") from None


class LeastSquares(BoxMinimiser):
    """A solver of minimise ‖Lᵀx − right‖ with bounds."""

    def build(self, p: Program, rows: Stack) -> None:
        self.L = cholesky(p.P, self.name)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        if P is not None:
            self.L = cholesky(P, self.name)

    def right(self, linear: Vector) -> Vector:
        """−L⁻¹ times a linear cost, shape (d,)."""
        return solve_triangular(self.L, -linear, lower=True, check_finite=False)


class NonNegative(LeastSquares):
    """A solver of minimise ‖A u − b‖ with u ≥ 0; needs a finite lower bound everywhere and no upper bound."""

    def build(self, p: Program, rows: Stack) -> None:
        super().build(p, rows)
        if np.any(np.isfinite(p.ub)) or not np.all(np.isfinite(p.lb)):
            raise Unsupported(f"{self.name} needs a finite lower bound and no upper bound on every variable")

    @abstractmethod
    def nonnegative(self, A: Matrix, b: Vector) -> Vector:
        """Call the library, which raises RuntimeError when it runs out of iterations."""

    def minimise(self, start: Vector | None) -> BoxResult:
        try:
            u = self.nonnegative(self.L.T, self.right(self.program.P @ self.program.lb + self.program.q))
        except RuntimeError as error:
            return np.full(self.program.d, np.nan), False, str(error), None
        return self.program.lb + u, True, "solved", None


class LsqLinear(LeastSquares):
    """scipy.optimize.lsq_linear; its ``tol`` is relative, on the cost and (trf) on the scaled gradient."""

    method: ClassVar[Any]
    refuses_fixed = True

    def minimise(self, start: Vector | None) -> BoxResult:
        result = lsq_linear(
            self.L.T,
            self.right(self.program.q),
            (self.program.lb, self.program.ub),
            method=self.method,
            **self.settings,
        )
        return result.x, bool(result.success), str(result.message), int(result.nit)
