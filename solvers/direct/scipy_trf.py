"""Trust region reflective method (SciPy's lsq_linear, method trf), an interior method.

    minimise ‖Lᵀx + L⁻¹q‖   subject to   lb ≤ x ≤ ub   with   P = L Lᵀ

Source: M. A. Branch, T. F. Coleman, Y. Li, "A subspace, interior, and conjugate gradient method for large-scale
bound-constrained minimization problems", SIAM Journal on Scientific Computing 21 (1999), pages 1 to 23.

Timed: ``setup`` and ``update`` factorise; ``solve`` does a triangular solve and lsq_linear. There is no warm start. The
answer stays strictly inside the box, so its duals are those that stationarity asks for.
"""

from __future__ import annotations

from types import MappingProxyType

from qpsolvers import Solution

from solvers.direct._box import bound_duals, cost
from solvers.direct._least_squares import LsqLinear
from solvers.protocol import Tier


class ScipyTrf(LsqLinear):
    """scipy.optimize.lsq_linear(method="trf")."""

    name = "scipy_trf"
    algorithm = "trust region reflective"
    method = "trf"
    tiers = MappingProxyType({tier: {"tol": tier.tolerance, "max_iter": 10_000}
                              for tier in (Tier.LOW, Tier.MID, Tier.HIGH)})

    def solution(self) -> Solution:  # noqa: D102
        solution = super().solution()
        if self.outcome.found:
            solution.z_box = bound_duals(cost(self.program, self.outcome.x)[1], self.lb, self.ub)
        return solution
