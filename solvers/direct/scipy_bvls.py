"""Bounded-variable least squares of Stark and Parker (SciPy's lsq_linear, method bvls), an active set method.

    minimise ‖Lᵀx + L⁻¹q‖   subject to   lb ≤ x ≤ ub   with   P = L Lᵀ

Source: P. B. Stark, R. L. Parker, "Bounded-variable least squares: an algorithm and applications", Computational
Statistics 10 (1995), pages 129 to 141.

Timed: ``setup`` and ``update`` factorise; ``solve`` does a triangular solve and lsq_linear. There is no warm start.
"""

from scipy.optimize import lsq_linear

from solvers.adapter import Vector
from solvers.direct._box import BoxResult, LeastSquares


class ScipyBvls(LeastSquares):
    """scipy.optimize.lsq_linear(method="bvls"); its ``tol`` is relative, on the cost."""

    refuses_fixed = True

    def minimise(self, start: Vector | None) -> BoxResult:
        p = self.program
        result = lsq_linear(self.L.T, self.right(p.q), (p.lb, p.ub), method="bvls", **self.settings)
        return result.x, bool(result.success), str(result.message), int(result.nit)
