"""A quadratic cost that follows its data row by row and forgets the old ones.

    P ← λ P + (1 − λ) ξ ξᵀ,    q ← λ q + (1 − λ) ξ x,    c ← λ c + (1 − λ) ½ x²      for each row (ξ, x)

is the mean of the squared errors ½ (vᵀξ + x)² with exponentially fading weights; a row has faded to 1/e after
1/(1 − λ) rows. It is the update that every solver on a stream of data is handed, and that those which take rows do
themselves.

Source: L. Ljung, System Identification, 1999, section 11.2 (forgetting factor).
"""

from solvers.core import bindings
from solvers.protocol import Matrix, Vector


def absorb(P: Matrix, q: Vector, c: Vector, rows: Matrix, first: int, last: int, forgetting: float) -> None:
    """Take the rows first … last − 1 of ``rows`` (N, d + 1), each (ξ, x), into P (d, d), q (d,) and c (1,).

    Row by row, so that the same rows give the same bits in whatever portions they come; P stays symmetric to the last
    bit.

    Examples
    --------
    >>> import numpy as np
    >>> P, q, c = np.eye(2), np.zeros(2), np.zeros(1)
    >>> absorb(P, q, c, np.array([[2.0, 0.0, 1.0]]), 0, 1, 0.5)
    >>> P.tolist(), q.tolist(), c.tolist()
    ([[2.5, 0.0], [0.0, 0.5]], [1.0, 0.0], [0.25])
    """
    bindings.absorb(P, q, c, rows[first:last], forgetting)
