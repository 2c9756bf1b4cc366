"""Bounded-variable least squares of Stark and Parker (SciPy's lsq_linear, method bvls), an active set method.

    minimise ‖Lᵀx + L⁻¹q‖   subject to   lb ≤ x ≤ ub   with   P = L Lᵀ

Source: P. B. Stark, R. L. Parker, "Bounded-variable least squares: an algorithm and applications", Computational
Statistics 10 (1995), pages 129 to 141.

Timed: ``setup`` and ``update`` factorise; ``solve`` does a triangular solve and lsq_linear. There is no warm start.
"""

from solvers.backend import Backend, relative
from solvers.direct._least_squares import LsqLinear


class ScipyBvls(LsqLinear):
    """scipy.optimize.lsq_linear(method="bvls")."""

    library = Backend(
        "active set", "BSD-3-Clause", "scipy", {"tol": relative}, (8, 12), rung_settings={"max_iter": 10_000}
    )
    method = "bvls"
