"""Scaling of a program with general rows by powers of two, which is free of rounding errors.

With x = D z the cost is multiplied by κ and the rows by E:

    P' = κ D P D,   q' = κ D q,   [A'; G'] = E [A; G] D,   [b'; h'] = E [b; h],   lb' = D⁻¹ lb,   ub' = D⁻¹ ub

D and E bring the rows and columns of [P Cᵀ; C 0] near the largest element one (D. Ruiz, "A scaling algorithm to
equilibrate both rows and columns norms in matrices", RAL-TR-2001-034), κ the cost, as OSQP does it (B. Stellato and
others, Math. Program. Comput. 12, 2020, section 5.1). All are rounded to powers of two, so that the scaled program is
exactly the given one and has the same optimum; its P has a diagonal between about 1/4 and 4 instead of ones.
"""

from typing import Any

import numpy as np
from qpsolvers import Problem
from scipy.sparse import bmat, csc_matrix, diags, vstack

from solvers.arrays import Vector

PASSES = 10


def equilibrated(qp: Problem) -> tuple[Problem, Vector, float]:
    """The scaled program in z, the diagonal (d,) of D, with x = D z, and κ.

    Parameters
    ----------
    qp : qpsolvers.Problem
        Of d variables; matrices that are dense stay dense, and sparse ones stay sparse.

    Examples
    --------
    >>> qp = Problem(np.diag([4e6, 1.0]), np.array([2e3, 1.0]), lb=np.zeros(2), ub=np.full(2, 8.0))
    >>> scaled, unit, _ = equilibrated(qp)
    >>> unit.tolist(), scaled.ub.tolist(), scaled.P.diagonal().round(2).tolist()
    ([0.00048828125, 1.0], [16384.0, 8.0], [0.95, 1.0])
    """
    d = qp.q.size
    P = abs(csc_matrix(qp.P))
    C = abs(vstack([csc_matrix((0, d)), *(csc_matrix(M) for M in (qp.A, qp.G) if M is not None)]))
    K, S = bmat([[P, C.T], [C, None]]), np.ones(d + C.shape[0])
    for _ in range(PASSES):
        largest = _largest_by_column(K, S)
        S = S / np.sqrt(np.where(largest > 0.0, largest, 1.0))
    S = _power_of_two(S)
    D, E = S[:d], S[d:]
    size = max(float(np.mean(_largest_by_column(P, D))), float(np.max(np.abs(D * qp.q))))
    cost = float(_power_of_two(1.0 / size if size > 0.0 else 1.0))
    split = 0 if qp.A is None else qp.A.shape[0]
    P, G, A = (_times(left, M, D) for left, M in ((cost * D, qp.P), (E[split:], qp.G), (E[:split], qp.A)))
    sides = ((cost * D, qp.q), (E[split:], qp.h), (E[:split], qp.b), (1.0 / D, qp.lb), (1.0 / D, qp.ub))
    q, h, b, lb, ub = (None if side is None else factor * side for factor, side in sides)
    return Problem(P, q, G, h, A, b, lb, ub), D, cost


def _largest_by_column(M: Any, S: Vector) -> Vector:
    """Largest element of each column of diag(S) M diag(S), for a non-negative matrix."""
    return np.asarray((diags(S) @ M @ diags(S)).max(axis=0).toarray(), dtype=np.float64).ravel()


def _power_of_two(values: Any) -> Any:
    return np.exp2(np.round(np.log2(values)))


def _times(left: Vector, M: Any, right: Vector) -> Any:
    """diag(left) M diag(right), sparse if M is; None without M."""
    if M is None:
        return None
    return left[:, None] * M * right if isinstance(M, np.ndarray) else csc_matrix(diags(left) @ M @ diags(right))
