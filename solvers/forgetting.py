"""A quadratic cost that is updated row by row with exponential forgetting.

    P ← λ P + (1 − λ) ξ ξᵀ,    q ← λ q + (1 − λ) ξ x,    c ← λ c + (1 − λ) ½ x²      for each row (ξ, x)

is the mean of the squared errors ½ (vᵀξ + x)² with exponentially decaying weights; the weight of a row decays to 1/e
after 1/(1 − λ) rows. On a stream of data, solvers get P and q from this update.

Source: L. Ljung, System Identification, 1999, section 11.2 (forgetting factor).
"""

from solvers.core import bindings
from solvers.protocol import Matrix, Vector


def absorb(P: Matrix, q: Vector, c: Vector, rows: Matrix, first: int, last: int, forgetting: float) -> None:
    """Add the rows first … last − 1 of ``rows`` (N, d + 1), each (ξ, x), to P (d, d), q (d,) and c (1,).

    The result does not depend on how the rows are split over calls, and P stays exactly symmetric.

    Examples
    --------
    >>> import numpy as np
    >>> P, q, c = np.eye(2), np.zeros(2), np.zeros(1)
    >>> absorb(P, q, c, np.array([[2.0, 0.0, 1.0]]), 0, 1, 0.5)
    >>> P.tolist(), q.tolist(), c.tolist()
    ([[2.5, 0.0], [0.0, 0.5]], [1.0, 0.0], [0.25])
    """
    bindings.absorb(P, q, c, rows[first:last], forgetting)
