"""Active set of Lawson and Hanson (SciPy's nnls) on the Cholesky factor of P.

With P = L Lᵀ, x = lb + u and g = P lb + q:

    minimise ‖Lᵀu + L⁻¹g‖   subject to   u ≥ 0

Source: C. L. Lawson, R. J. Hanson, Solving Least Squares Problems (1974), chapter 23.

Timed: ``setup`` and ``update`` factorise; ``solve`` does a triangular solve and nnls. It has no tolerance (``atol`` is
without effect since SciPy 1.12), so there is one rung, and no warm start.
"""

from scipy.optimize import nnls

from solvers.backend import Backend
from solvers.direct._least_squares import NonNegative
from solvers.protocol import Matrix, Vector


class ScipyNnls(NonNegative):
    """scipy.optimize.nnls; needs a finite lower bound everywhere and no upper bound."""

    library = Backend("active set", "BSD-3-Clause", "scipy")

    def nonnegative(self, A: Matrix, b: Vector) -> Vector:
        return nnls(A, b)[0]
