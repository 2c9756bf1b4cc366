"""The data of a box QP in two work arrays: allocated once, scaled, checked and factorised here.

    minimise ½ xᵀP x + qᵀx  subject to  lb ≤ x ≤ ub

The variables are scaled, x = S z with S_jj a power of two that brings (S P S)_jj into [½, 2): that is exact, so lb, ub and
the answer are the caller's to the last bit, and tolerances may be absolute. Diagonal scaling within a factor of two of
unit diagonal is within a factor of two (and d) of the best condition number a diagonal can give (van der Sluis,
Numer. Math. 14 (1969) 14).

``work`` holds the rows of :mod:`solvers.kernels.box_factor`, ``iwork`` the rows STATE, SIDE (where each variable is), WANTED
(where it should be) and LIST (the free ones, as ``factorise`` takes them). All functions are plain ``@njit`` except
:func:`allocate`, and the ``set_`` functions return OK or a key of REASONS.
"""

from __future__ import annotations

import math

import numpy as np

from solvers.kernels.box_factor import (
    ANSWER,
    HI,
    LO,
    RAW_LB,
    RAW_Q,
    RAW_UB,
    SCALE,
    STEP,
    Integers,
    P,
    Q,
    back_substitute,
    factorise,
    leading,
)
from solvers.kernels.vector import aligned, compiled
from solvers.protocol import Matrix, Vector

OK, UNBOUNDED, INDEFINITE, ENDLESS, NOT_FINITE, CROSSED, ASYMMETRIC, BREAKDOWN = range(8)
REASONS = {
    UNBOUNDED: "the problem is unbounded below: q points down a direction that P does not see and no bound stops",
    INDEFINITE: "P is indefinite beyond rounding, so the problem is not convex",
    ENDLESS: "no active set met the optimality conditions within the limit of linear systems",
    NOT_FINITE: "P, q and a starting point must be finite and bounds must not be NaN",
    CROSSED: "a lower bound lies above its upper bound or at +inf, or an upper bound at -inf",
    ASYMMETRIC: "P is not symmetric",
    BREAKDOWN: "P is too close to indefinite even with the proximal term",
}

STATE, SIDE, WANTED, LIST = range(4)
"""Rows of the integer array."""
SIZE, COUNT, FIRST, SINGULAR, SYSTEMS, DUAL_STEPS, PROXIMAL_STEPS = range(7)
"""In STATE: d, number of free variables, first variable whose column of the factor is stale, whether P is
regularised, and what the last solve took: linear systems, steps of the dual method, proximal steps."""
LOWER, FREE, UPPER, FIXED = -1, 0, 1, 2
"""What stands in SIDE."""

PROXIMAL = 1e-11
"""δ of the proximal term, relative to the diagonal of P."""
EPS = float(np.finfo(np.float64).eps)


def allocate(d: int) -> tuple[Matrix, Integers]:
    """Work arrays of a problem with d variables; ``work[0, :d]`` is where the answer will stand."""
    ld = leading(d)
    work = aligned(P + 3 * ld, ld)
    work[SCALE] = 1.0
    work[RAW_LB], work[RAW_UB] = -np.inf, np.inf
    for j in range(d, ld):
        work[P + j, j] = 1.0
    iwork = np.zeros((4, ld), np.int64)
    iwork[STATE, SIZE] = d
    return work, iwork


@compiled
def set_hessian(work: Matrix, iwork: Integers, hessian: Matrix) -> int:
    """Take P, shape (d, d), as its symmetric part, and factorise it; q, bounds and the active set stay."""
    d = iwork[STATE, SIZE]
    for j in range(d):
        diagonal = hessian[j, j]
        if not abs(diagonal) < np.inf:
            return NOT_FINITE
        if diagonal < 0.0:
            return INDEFINITE
        work[SCALE, j] = math.ldexp(1.0, -(math.frexp(diagonal)[1] // 2))
    total, gap = 0.0, 0.0
    for i in range(d):
        s = work[SCALE, i]
        for j in range(d):
            a, b = hessian[i, j], hessian[j, i]
            scale = s * work[SCALE, j]
            gap = max(gap, abs(a - b) * scale)
            mean = 0.5 * (a + b) * scale
            total += abs(mean)
            work[P + i, j] = mean
    if not total < np.inf:
        return NOT_FINITE
    if gap > 1e-9:
        return ASYMMETRIC
    _rescale(work, d)
    iwork[STATE, SINGULAR] = 0
    if _factorise_all(work, iwork) > 16 * d * EPS and _inverse_norm(work, iwork) < 0.02 / (d * EPS):
        return OK
    return regularise(work, iwork)


@compiled
def regularise(work: Matrix, iwork: Integers) -> int:
    """Add the proximal term to P; INDEFINITE where that is not enough."""
    for j in range(iwork[STATE, SIZE]):
        work[P + j, j] += PROXIMAL
    iwork[STATE, SINGULAR] = 1
    return OK if _factorise_all(work, iwork) > 0.0 else INDEFINITE


@compiled
def _factorise_all(work: Matrix, iwork: Integers) -> float:
    """Factorise P with every variable free, which is where a cold start begins; the smallest pivot.

    The right-hand side is irregular, so that the solution is as long as 1/λ_min says (see ``_inverse_norm``).
    """
    d = iwork[STATE, SIZE]
    for j in range(d):
        iwork[LIST, j] = j
        work[P + j, d] = (0.618033988749895 * (j + 1)) % 1.0 - 0.5
    count = finish_list(iwork, d)
    iwork[STATE, COUNT], iwork[STATE, FIRST] = d, work.shape[1]
    return factorise(work, iwork[LIST, :count + 1], d, 0)


@compiled
def _inverse_norm(work: Matrix, iwork: Integers) -> float:
    """A lower estimate of |P⁻¹|: pivots alone do not show a null vector that has little of the last variable."""
    d = iwork[STATE, SIZE]
    back_substitute(work, iwork[LIST], (d + 3) & ~3, d)
    longest = 0.0
    for j in range(d):
        longest = max(longest, abs(work[STEP, j]))
    return longest


@compiled
def finish_list(iwork: Integers, count: int) -> int:
    """Fill the list of free variables up with unit columns and its end; how many entries it then has."""
    unit = iwork[STATE, SIZE] + 1
    while count % 4 != 0:
        iwork[LIST, count] = unit
        count, unit = count + 1, unit + 1
    iwork[LIST, count] = -1
    return count


@compiled
def set_linear(work: Matrix, iwork: Integers, q: Vector) -> int:
    """Take q, shape (d,)."""
    for i in range(iwork[STATE, SIZE]):
        if not abs(q[i]) < np.inf:
            return NOT_FINITE
        work[RAW_Q, i] = q[i]
        work[Q, i] = q[i] * work[SCALE, i]
    return OK


@compiled
def set_bounds(work: Matrix, iwork: Integers, lb: Vector, ub: Vector) -> int:
    """Take lb and ub, shape (d,); infinite where there is none, equal where the variable is fixed."""
    d = iwork[STATE, SIZE]
    for i in range(d):
        if np.isnan(lb[i]) or np.isnan(ub[i]):
            return NOT_FINITE
        if not (lb[i] <= ub[i] and lb[i] < np.inf and ub[i] > -np.inf):
            return CROSSED
        work[RAW_LB, i], work[RAW_UB, i] = lb[i], ub[i]
    _rescale(work, d)
    return OK


@compiled
def start_from(work: Matrix, iwork: Integers, x: Vector) -> int:
    """Make x, shape (d,), the answer that a warm start begins with: at a bound what touches it, else free."""
    for i in range(iwork[STATE, SIZE]):
        if not abs(x[i]) < np.inf:
            return NOT_FINITE
        work[ANSWER, i] = x[i]
        iwork[SIDE, i] = UPPER if x[i] >= work[RAW_UB, i] else LOWER if x[i] <= work[RAW_LB, i] else FREE
    return OK


@compiled
def _rescale(work: Matrix, d: int) -> None:
    """Bring q and the bounds to the scaled variables."""
    for i in range(d):
        s = work[SCALE, i]
        work[Q, i], work[LO, i], work[HI, i] = work[RAW_Q, i] * s, work[RAW_LB, i] / s, work[RAW_UB, i] / s
