"""Trust region reflective method (SciPy's lsq_linear, method trf), an interior method.

    minimise ‖Lᵀx + L⁻¹q‖   subject to   lb ≤ x ≤ ub   with   P = L Lᵀ

Source: M. A. Branch, T. F. Coleman, Y. Li, "A subspace, interior, and conjugate gradient method for large-scale
bound-constrained minimization problems", SIAM Journal on Scientific Computing 21 (1999), pages 1 to 23.

Timed: ``setup`` and ``update`` factorise; ``solve`` does a triangular solve and lsq_linear. There is no warm start. The
answer is strictly inside the box, so its duals are computed from stationarity.
"""

from solvers.adapter import Report
from solvers.backend import Backend, relative
from solvers.direct._box import bound_duals, cost
from solvers.direct._least_squares import LsqLinear


class ScipyTrf(LsqLinear):
    """scipy.optimize.lsq_linear(method="trf")."""

    library = Backend(
        "trust region reflective",
        "BSD-3-Clause",
        "scipy",
        {"tol": relative},
        (4, 6, 8, 10, 12, 14, 15),
        rung_settings={"max_iter": 10_000},
    )
    method = "trf"

    def report(self) -> Report:
        return super().report()._replace(w=bound_duals(cost(self.program, self.outcome.x)[1], self.lb, self.ub))
