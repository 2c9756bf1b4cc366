"""Fast non-negative least squares of Bro and de Jong (the package fnnlsEigen) on the Cholesky factor of P.

With P = L Lᵀ, x = lb + u and g = P lb + q:

    minimise ‖Lᵀu + L⁻¹g‖   subject to   u ≥ 0

Source: R. Bro, S. de Jong, "A fast non-negativity-constrained least squares algorithm", Journal of Chemometrics 11
(1997), pages 393 to 401.

Timed: ``setup`` and ``update`` factorise; ``solve`` does a triangular solve and calls the library, which computes L Lᵀ
again; its object that stores this product is no faster if P changes each time. Its tolerance, 0 up to rounding, changed
no answer between 1e-8 and 1e-16, so there is one rung. There is no warm start.
"""

import fnnlsEigen
import numpy as np

from solvers.backend import Backend
from solvers.direct._least_squares import NonNegative
from solvers.protocol import Matrix, Vector


class FnnlsEigen(NonNegative):
    """The library's ``fnnls``; needs a finite lower bound everywhere and no upper bound."""

    library = Backend("active set", "MIT", "fnnlsEigen")

    def nonnegative(self, A: Matrix, b: Vector) -> Vector:
        return fnnlsEigen.fnnls(np.ascontiguousarray(A), b)
