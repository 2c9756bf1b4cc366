"""Active set of Lawson and Hanson (SciPy's nnls) on the Cholesky factor of P.

With P = L Lᵀ, x = lb + u and g = P lb + q:

    minimise ‖Lᵀu + L⁻¹g‖   subject to   u ≥ 0

Source: C. L. Lawson, R. J. Hanson, Solving Least Squares Problems (1974), chapter 23.

Timed: ``setup`` and ``update`` factorise; ``solve`` does a triangular solve and nnls. It has no tolerance (``atol`` is
without effect since SciPy 1.12), so there is one rung, and no warm start.
"""

import numpy as np
from scipy.optimize import nnls

from solvers.adapter import Program, Stack, Unsupported, Vector
from solvers.direct._box import BoxResult, LeastSquares


class ScipyNnls(LeastSquares):
    """scipy.optimize.nnls; needs a finite lower bound everywhere and no upper bound."""

    def build(self, p: Program, rows: Stack) -> None:
        super().build(p, rows)
        if np.any(np.isfinite(p.ub)) or not np.all(np.isfinite(p.lb)):
            raise Unsupported(f"{self.name} needs a finite lower bound and no upper bound on every variable")

    def minimise(self, start: Vector | None) -> BoxResult:
        p = self.program
        try:
            return p.lb + nnls(self.L.T, self.right(p.P @ p.lb + p.q))[0], True, "solved", None
        except RuntimeError as error:  # it runs out of iterations
            return np.full(p.d, np.nan), False, str(error), None
