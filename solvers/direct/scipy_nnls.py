"""Active set of Lawson and Hanson (SciPy's nnls) on the Cholesky factor of P.

With P = L Lᵀ, x = lb + u and g = P lb + q:

    minimise ‖Lᵀu + L⁻¹g‖   subject to   u ≥ 0

Source: C. L. Lawson, R. J. Hanson, Solving Least Squares Problems (1974), chapter 23.

Timed: ``setup`` and ``update`` factorise; ``solve`` does a triangular solve and nnls. It has no tolerance, so all tiers
are alike, and no warm start.
"""

from __future__ import annotations

import numpy as np
from qpsolvers import Problem
from scipy.optimize import nnls

from solvers.direct._box import Outcome
from solvers.direct._least_squares import LeastSquares
from solvers.protocol import Unsupported, Vector


class ScipyNnls(LeastSquares):
    """scipy.optimize.nnls; needs a finite lower bound everywhere and no upper bound."""

    name = "scipy_nnls"
    algorithm = "active set"

    def setup(self, problem: Problem) -> None:  # noqa: D102
        super().setup(problem)
        if np.any(np.isfinite(self.ub)) or not np.all(np.isfinite(self.lb)):
            raise Unsupported("scipy_nnls needs a finite lower bound and no upper bound on every variable")

    def minimise(self, start: Vector | None) -> Outcome:  # noqa: D102
        right = self.right(self.program.P @ self.lb + self.program.q)
        try:
            u, _ = nnls(self.L.T, right, **self.settings)
        except RuntimeError as error:  # nnls's way of saying that it ran out of iterations
            return Outcome(self.program.no_answer(), False, str(error))
        return Outcome(self.lb + u, True, "solved")
