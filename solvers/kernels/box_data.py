"""The data of a box QP in two work arrays: allocated once, scaled, checked and factorised here.

    minimise ½ xᵀP x + qᵀx  subject to  lb ≤ x ≤ ub

The variables are scaled, x = S z with S_jj a power of two that brings (S P S)_jj into [½, 2): that is exact, so lb, ub and
the answer are the caller's to the last bit, and tolerances may be absolute. Diagonal scaling within a factor of two of
unit diagonal is within a factor of two (and d) of the best condition number a diagonal can give (van der Sluis,
Numer. Math. 14 (1969) 14).

``work`` holds the rows of :mod:`solvers.kernels.box_factor`, ``iwork`` the rows STATE, SIDE (where each variable is), WANTED
(where it should be) and LIST (the free ones, as ``factorise`` takes them). All functions are compiled but
:func:`allocate` and :func:`taken_hessian`, and the ``set_`` functions return OK or a key of REASONS.
"""

from __future__ import annotations

import math

import numpy as np

from solvers.compiled import aligned, compiled
from solvers.kernels.box_factor import (
    ANSWER,
    CURVATURE,
    HI,
    INVERSE_DIAGONAL,
    LO,
    ONE,
    PRESENT,
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
    skew_rows,
)
from solvers.kernels.vector import load, store
from solvers.protocol import Matrix, Vector
from solvers.vector8 import splat8, sum8

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
(SIZE, COUNT, FIRST, SINGULAR, SYSTEMS, DUAL_STEPS, PROXIMAL_STEPS, EXCHANGES, FALLBACKS, INVERTED, FACTORISED,
 STATES) = range(12)
"""In STATE: d, number of free variables, first variable whose column of the factor is stale, whether P is
regularised; what the last solve took: linear systems, steps of the dual method, proximal steps, exchanges; how many solves were
left to the factorisation; which of P⁻¹ and the factor are there."""
LOWER, FREE, UPPER, FIXED = -1, 0, 1, 2
"""What stands in SIDE."""

PROXIMAL = 1e-11
"""δ of the proximal term, relative to the diagonal of P."""
EPS = float(np.finfo(np.float64).eps)


def allocate(d: int) -> tuple[Matrix, Integers]:
    """Work arrays of a problem with d variables; ``work[0, :d]`` is where the answer will stand."""
    ld = leading(d)
    work = aligned(P + 7 * ld, ld)
    work[SCALE], work[CURVATURE], work[INVERSE_DIAGONAL], work[PRESENT, :d], work[ONE, 0] = 1.0, 1.0, -1.0, 1.0, 1.0
    work[LO], work[HI] = work[RAW_LB], work[RAW_UB] = -np.inf, np.inf
    skew = np.triu(0.5 + (0.618033988749895 * np.arange(d * d).reshape(d, d)) % 1.0, 1)
    work[skew_rows.py_func(work):, :d][:d] = skew - skew.T
    for j in range(d, ld):
        work[P + j, j] = 1.0
    iwork = np.zeros((4, max(ld, STATES)), np.int64)
    iwork[STATE, SIZE] = d
    return work, iwork


@compiled
def set_hessian(work: Matrix, iwork: Integers, hessian: Matrix) -> int:
    """Take P, shape (d, d), as its symmetric part, and factorise it; q, bounds and the active set stay."""
    d = iwork[STATE, SIZE]
    iwork[STATE, INVERTED] = 0
    for j in range(d):
        diagonal = hessian[j, j]
        if not abs(diagonal) < np.inf:
            return NOT_FINITE
        if diagonal < 0.0:
            return INDEFINITE
        work[SCALE, j] = math.ldexp(1.0, -(math.frexp(diagonal)[1] // 2))
    for i in range(d):
        for j in range(d):
            work[P + i, j] = hessian[i, j] * (work[SCALE, i] * work[SCALE, j])
    rescale(work, iwork)
    return factorise_copy(work, iwork)


@compiled
def factorise_copy(work: Matrix, iwork: Integers) -> int:
    """Make the scaled copy of P its symmetric part, and factorise it."""
    d = iwork[STATE, SIZE]
    total, gap = 0.0, 0.0
    for i in range(d):
        for j in range(i + 1):
            a, b = work[P + i, j], work[P + j, i]
            mean = 0.5 * (a + b)
            gap = max(gap, abs(a - b))
            total += abs(mean)
            work[P + i, j], work[P + j, i] = mean, mean
    if not total < np.inf:
        return NOT_FINITE
    if gap > 1e-9:
        return ASYMMETRIC
    iwork[STATE, SINGULAR], iwork[STATE, FACTORISED] = 0, 1
    if _factorise_all(work, iwork) > 16 * d * EPS and _inverse_norm(work, iwork) < 0.02 / (d * EPS):
        return OK
    return regularise(work, iwork)


def taken_hessian(work: Matrix, iwork: Integers) -> Matrix:
    """P, shape (d, d), from its scaled copy; exact but for the last bit of the diagonal where P is regularised."""
    d = iwork[STATE, SIZE]
    copy = work[P:P + d, :d] - PROXIMAL * iwork[STATE, SINGULAR] * np.eye(d)
    taken: Matrix = copy / work[SCALE, :d] / work[SCALE, :d, None]
    return taken


@compiled
def regularise(work: Matrix, iwork: Integers) -> int:
    """Add the proximal term to P; INDEFINITE where that is not enough."""
    for j in range(iwork[STATE, SIZE]):
        work[P + j, j] += PROXIMAL
    iwork[STATE, SINGULAR], iwork[STATE, INVERTED] = 1, 0
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
    d, nothing = iwork[STATE, SIZE], splat8(0.0)
    for i in range(d):
        work[RAW_Q, i] = q[i]
    for b in range(0, (d + 7) & ~7, 8):
        raw = load(work, RAW_Q, b)
        nothing = nothing + (raw - raw)  # NaN where q is not finite
        store(work, Q, b, raw * load(work, SCALE, b))
    return OK if sum8(nothing) == 0.0 else NOT_FINITE


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
    rescale(work, iwork)
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
def rescale(work: Matrix, iwork: Integers) -> None:
    """Bring q and the bounds to the scaled variables."""
    for b in range(0, (iwork[STATE, SIZE] + 7) & ~7, 8):
        scale = load(work, SCALE, b)
        inverse = 1.0 / scale
        store(work, Q, b, load(work, RAW_Q, b) * scale)
        store(work, LO, b, load(work, RAW_LB, b) * inverse)
        store(work, HI, b, load(work, RAW_UB, b) * inverse)
