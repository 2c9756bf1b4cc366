"""The optimum of a box QP after every row: the row in, the swept matrix moved by rank one, the optimum out.

One more row ξ changes G by ξξᵀ, and M (:mod:`solvers.kernels.swept_gram`) by a matrix of rank one as well (Sherman–Morrison
on each block):

    u = ξ_A − M[:, F] ξ_F,    σ = 1 + ξ_Fᵀ u_F,    M ← M + u uᵀ / σ.

So a sample costs 2 (d + 1)² multiplications and no square root or division but one, a change of the active set half of
that, and the exact optimum is there after every sample. Forgetting is in the weights: row k enters with λ^(−k/2) and the
clock k starts anew at each refresh.

Refresh rule. M is made anew (:mod:`solvers.kernels.swept_refresh`) after REFRESH rows; where the weights have grown to
GROWTH; and at the row that would bring the product of the σ since then, det G_FF after over before, to MOST_SURPRISE. A
row that says what the data left open has a large σ, and adding it to M cancels log₁₀ σ digits of the entries; so between two
refreshes M loses six digits and REFRESH roundings at most, and the cost errs to second order in that. A σ below one, which
takes a lost positive definiteness, and exchanges that do not end are answered in the same way.

Source: L. Ljung, System Identification, 1999, chapter 11 (recursive least squares).
"""

from __future__ import annotations

from solvers.compiled import inlined, kernel
from solvers.kernels.box_data import NOT_FINITE, OK
from solvers.kernels.swept_exchange import exchange, violated
from solvers.kernels.swept_gram import (
    ANSWER,
    FREE,
    LB,
    LEADING,
    ORIGIN,
    REFRESH,
    ROOT_GROWTH,
    ROOT_WEIGHT,
    ROW,
    ROW_WEIGHT,
    SIGN,
    SINCE_REFRESH,
    SIZE,
    SURPRISE,
    UB,
    VECTORS,
    Integers,
    U,
    Vector,
    subtract_free,
)
from solvers.kernels.swept_refresh import begin, recover, refresh
from solvers.nanoclock import monotonic_ns
from solvers.protocol import Matrix
from solvers.vector8 import load8, splat8, store8, sum8

GROWTH = 1e8
MOST_SURPRISE = 1e6
LARGEST = 1e100
"""Size from which a number of a row is refused, since sums of squares have to be finite."""


@inlined
def add_row(work: Vector, iwork: Integers, numbers: Vector) -> bool:
    """G ← G + ξξᵀ and M ← M + u uᵀ/σ for the weighted row ξ in ``work[ROW]``; False where M is left as it was for its σ."""
    d, ld = iwork[SIZE], iwork[LEADING]
    M, G, row, u = VECTORS * ld, (VECTORS + ld) * ld, ROW * ld, U * ld
    for b in range(0, ld, 8):
        xi = load8(work, row + b)
        store8(work, u + b, xi - load8(work, FREE * ld + b) * xi)
    subtract_free(work, iwork, M, row, u)
    dot = splat8(0.0)
    for b in range(0, ld, 8):
        dot = dot + load8(work, FREE * ld + b) * load8(work, row + b) * load8(work, u + b)
    sigma = 1.0 + sum8(dot)
    numbers[SURPRISE] *= sigma
    fits = sigma > 0.999 and numbers[SURPRISE] < MOST_SURPRISE  # NaN does not fit
    inverse = 1.0 / sigma
    if not fits:
        inverse = 0.0
        for b in range(0, ld, 8):
            store8(work, u + b, splat8(0.0))
    for i in range(d + 1):
        factor, weight = splat8(work[u + i] * inverse), splat8(work[row + i])
        for b in range(0, ld, 8):
            store8(work, M + i * ld + b, load8(work, M + i * ld + b) + factor * load8(work, u + b))
        for b in range(i & ~7, ld, 8):
            store8(work, G + i * ld + b, load8(work, G + i * ld + b) + weight * load8(work, row + b))
    return fits


@inlined
def take(work: Vector, iwork: Integers, numbers: Vector, rows: Vector, at: int) -> int:
    """Take one row (ξ, x) of d + 1 numbers from ``rows[at:]`` and restore optimality.

    Returns OK, or SINGULAR or CYCLING where only :func:`solvers.kernels.swept_refresh.recover` helps; the row is in G then.
    """
    d, ld = iwork[SIZE], iwork[LEADING]
    numbers[ROOT_WEIGHT] *= numbers[ROOT_GROWTH]
    weight = numbers[ROOT_WEIGHT]
    target = rows[at + d]
    for j in range(d):
        xi = rows[at + j]
        target += work[ORIGIN * ld + j] * xi
        work[ROW * ld + j] = weight * work[SIGN * ld + j] * xi
    work[ROW * ld + d] = weight * target
    fits = add_row(work, iwork, numbers)
    iwork[SINCE_REFRESH] += 1
    status = OK
    if iwork[SINCE_REFRESH] >= REFRESH or not fits or weight * weight >= GROWTH * numbers[ROW_WEIGHT]:
        status = refresh(work, iwork, numbers)
    elif violated(work, iwork):
        status = exchange(work, iwork)
        if status != OK:
            status = refresh(work, iwork, numbers)
    return status


@inlined
def write_answer(work: Vector, iwork: Integers) -> None:
    """v = ORIGIN + SIGN · z, inside its box to the last bit."""
    ld = iwork[LEADING]
    last = (VECTORS + iwork[SIZE]) * ld
    for b in range(0, ld, 8):
        z = load8(work, FREE * ld + b) * (0.0 - load8(work, last + b))
        v = load8(work, ORIGIN * ld + b) + load8(work, SIGN * ld + b) * z
        store8(work, ANSWER * ld + b, min(max(v, load8(work, LB * ld + b)), load8(work, UB * ld + b)))


@kernel
def take_row(work: Vector, iwork: Integers, numbers: Vector, row: Vector) -> int:
    """Take one row (ξ, x) of d + 1 numbers and answer; NOT_FINITE, and nothing changed, for one that cannot be taken."""
    for i in range(iwork[SIZE] + 1):
        if not abs(row[i]) < LARGEST:
            return NOT_FINITE
    status = take(work, iwork, numbers, row, 0)
    write_answer(work, iwork)
    return status


@kernel
def take_rows(work: Vector, iwork: Integers, numbers: Vector, cold: Matrix, sides: Integers, P: Matrix, q: Vector,
              rows: Vector, answers: Vector, nanoseconds: Integers) -> int:
    """Take N rows (ξ, x) of d + 1 numbers one after the other, with :func:`solvers.kernels.swept_refresh.recover` where it must be.

    The answer after each goes to ``answers`` (d numbers each) and the time that it took to ``nanoseconds``.
    """
    d, ld = iwork[SIZE], iwork[LEADING]
    for k in range(nanoseconds.size):
        start = monotonic_ns()
        status = take(work, iwork, numbers, rows, k * (d + 1))
        if status != OK:
            status = recover(work, iwork, numbers, cold, sides, P, q)
        write_answer(work, iwork)
        nanoseconds[k] = monotonic_ns() - start
        if status != OK:
            return status
        for j in range(d):
            answers[k * d + j] = work[ANSWER * ld + j]
    return OK


@kernel
def time_begin(work: Vector, iwork: Integers, numbers: Vector, cold: Matrix, sides: Integers, P: Matrix, q: Vector,
               nanoseconds: Integers) -> int:
    """Start from the same P and q again and again and note the time of each."""
    status, warm = OK, nanoseconds.size < 0  # a variable, since Numba compiles everything anew for a constant
    for k in range(nanoseconds.size):
        start = monotonic_ns()
        status = begin(work, iwork, numbers, cold, sides, P, q, 0.0, warm)
        nanoseconds[k] = monotonic_ns() - start
    return status
