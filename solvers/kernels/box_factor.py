"""P_FF = L D Lᵀ of the free block of a box QP, renewed from the first variable that changed, and its solves.

With F = j₀ < j₁ < … the free variables in ascending order and V = L D, column s of the left-looking form is

    V[:, s] = P[:, j_s] − Σ_{k<s} V[:, k] L[j_s, k],    D_s = V[j_s, s],    L[:, s] = V[:, s] / D_s

(Golub & Van Loan, Matrix Computations, 4th ed., sections 4.1 and 4.2). Four things make it fast at d = 18:

1. Rows are never gathered: column s keeps the row numbers of P, and rows of variables at a bound ride along unused.
2. Columns come in panels of four, filled up by unit columns: one load of V[:, k] serves four sums held in registers.
3. The right-hand side is row d of P, so that the forward solve is a lane of the factorisation and costs nothing.
4. Column s depends on the free variables up to j_s only: when F changes, the panels before the first change stay.
   They come out the same whatever the way there, so every answer is repeatable to the last bit.

Everything lives in one array ``work`` of rows of length ld, which is d + 4 (right-hand side and three unit columns) rounded
up to a multiple of eight: a row for each vector named below, then ld rows each with the columns of P, the columns of V (for
the sums) and the rows of L (for the multipliers and the back substitution); behind them are the ld rows of M
(:mod:`solvers.kernels.box_inverse`), 2 ld columns of exchanged variables (:mod:`solvers.kernels.box_exchange`) and ld rows of
weights. The functions allocate nothing and may be called from other compiled code.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solvers.compiled import compiled, inlined
from solvers.kernels.product import affine
from solvers.kernels.vector import broadcast, first_lanes, fnma, lane, load, store, store_columns
from solvers.protocol import Matrix
from solvers.vector8 import padded, splat8

Integers = NDArray[np.int64]

(ANSWER, X, G, Q, LO, HI, MULTIPLIER, CENTRE, INVERSE_PIVOT, STEP, SCALE, RAW_Q, RAW_LB, RAW_UB,
 # of the exchanges on the inverse, see box_inverse and box_exchange
 CURVATURE, INVERSE_DIAGONAL, INVERSE_WEIGHT, R, BELOW, ABOVE, AT, IS_FREE, UNIT, DIAGONAL, WEIGHT, GAIN, MASKED, FACTOR, _,
 SHARE, _, ZERO, PRESENT, BEFORE_ONE, ONE, PIVOT_ROWS, _, P) = range(38)
"""Rows at the head of the work array, X to STEP in scaled variables (see :mod:`solvers.kernels.box_data`), and the first row of P,
which V and L follow. FACTOR, SHARE and PIVOT_ROWS go on into the row after theirs."""


def leading(d: int) -> int:
    """Length ld of the rows of a problem with d variables."""
    return padded(d + 4)


@inlined
def inverse_rows(work: Matrix) -> int:
    """First of the ld rows of M."""
    return P + 3 * work.shape[1]


@inlined
def column_rows(work: Matrix) -> int:
    """First of the 2 ld rows for columns of exchanged variables."""
    return P + 4 * work.shape[1]


@inlined
def skew_rows(work: Matrix) -> int:
    """First of the ld rows of weights that show an unsymmetric P."""
    return P + 6 * work.shape[1]


@compiled
def factorise(work: Matrix, free: Integers, d: int, first: int) -> float:
    """Renew V and L from the first panel that holds a variable ≥ first, forward solve of row d included.

    ``free`` holds the free variables in ascending order, then unit columns d + 1, … up to a multiple of four, and then
    a −1. Returns the smallest pivot that was renewed, −inf where one is not a number.
    """
    ld = work.shape[1]
    V, L = P + ld, P + 2 * ld
    smallest = np.inf
    s = _forward(work, free, d, first)
    while free[s] >= 0:
        j0, j1, j2, j3 = free[s], free[s + 1], free[s + 2], free[s + 3]
        p0, p1, p2, p3 = P + j0, P + j1, P + j2, P + j3
        l0, l1, l2, l3 = L + j0, L + j1, L + j2, L + j3
        v = V + s
        top = j0 & ~7
        b = top
        while b + 8 < ld:
            a0, a1, a2, a3 = load(work, p0, b), load(work, p1, b), load(work, p2, b), load(work, p3, b)
            e0, e1, e2, e3 = load(work, p0, b + 8), load(work, p1, b + 8), load(work, p2, b + 8), load(work, p3, b + 8)
            for k in range(s):
                y, z = load(work, V + k, b), load(work, V + k, b + 8)
                m0, m1 = broadcast(work, l0, k), broadcast(work, l1, k)
                m2, m3 = broadcast(work, l2, k), broadcast(work, l3, k)
                a0, a1, a2, a3 = fnma(y, m0, a0), fnma(y, m1, a1), fnma(y, m2, a2), fnma(y, m3, a3)
                e0, e1, e2, e3 = fnma(z, m0, e0), fnma(z, m1, e1), fnma(z, m2, e2), fnma(z, m3, e3)
            _store4(work, v, b, a0, a1, a2, a3)
            _store4(work, v, b + 8, e0, e1, e2, e3)
            b += 16
        if b < ld:
            a0, a1, a2, a3 = load(work, p0, b), load(work, p1, b), load(work, p2, b), load(work, p3, b)
            for k in range(s):
                y = load(work, V + k, b)
                a0, a1 = fnma(y, broadcast(work, l0, k), a0), fnma(y, broadcast(work, l1, k), a1)
                a2, a3 = fnma(y, broadcast(work, l2, k), a2), fnma(y, broadcast(work, l3, k), a3)
            _store4(work, v, b, a0, a1, a2, a3)

        # The 4 × 4 diagonal block as scalars: its four divisions are the critical path.
        d0, c10, c20, c30 = work[v, j0], work[v, j1], work[v, j2], work[v, j3]
        d1, c21, c31 = work[v + 1, j1], work[v + 1, j2], work[v + 1, j3]
        d2, c32, d3 = work[v + 2, j2], work[v + 2, j3], work[v + 3, j3]
        i0 = 1.0 / d0
        l10, l20, l30 = c10 * i0, c20 * i0, c30 * i0
        d1, c21, c31 = d1 - c10 * l10, c21 - c20 * l10, c31 - c30 * l10
        i1 = 1.0 / d1
        l21, l31 = c21 * i1, c31 * i1
        d2, c32 = d2 - c20 * l20 - c21 * l21, c32 - c30 * l20 - c31 * l21
        i2 = 1.0 / d2
        l32 = c32 * i2
        d3 = d3 - c30 * l30 - c31 * l31 - c32 * l32
        i3 = 1.0 / d3
        least = min(min(d0, d1), min(d2, d3))
        smallest = least if least < smallest else smallest
        if not d0 + d1 + d2 + d3 < np.inf:
            return -np.inf
        _store_scalars(work, INVERSE_PIVOT, s, i0, i1, i2, i3)

        m10, m20, m30, m21, m31, m32 = splat8(l10), splat8(l20), splat8(l30), splat8(l21), splat8(l31), splat8(l32)
        for b in range(top, ld, 8):
            a0 = load(work, v, b)
            a1 = fnma(a0, m10, load(work, v + 1, b))
            a2 = fnma(a1, m21, fnma(a0, m20, load(work, v + 2, b)))
            a3 = fnma(a2, m32, fnma(a1, m31, fnma(a0, m30, load(work, v + 3, b))))
            _store4(work, v, b, a0, a1, a2, a3)
            store_columns(work, L + b, s, a0 * i0, a1 * i1, a2 * i2, a3 * i3)
        s += 4
    return smallest


@compiled
def _store4(work, row, column, a0, a1, a2, a3):  # type: ignore[no-untyped-def]
    store(work, row, column, a0)
    store(work, row + 1, column, a1)
    store(work, row + 2, column, a2)
    store(work, row + 3, column, a3)


@compiled
def _store_scalars(work: Matrix, row: int, s: int, a0: float, a1: float, a2: float, a3: float) -> None:
    work[row, s], work[row, s + 1], work[row, s + 2], work[row, s + 3] = a0, a1, a2, a3


@compiled
def _forward(work: Matrix, free: Integers, d: int, first: int) -> int:
    """Forward solve of the right-hand side, in STEP, through the panels that stay; returns the column where they end."""
    ld, s = work.shape[1], 0
    L = P + 2 * ld
    while free[s] >= 0 and free[s + 3] < first:
        j0, j1, j2, j3 = free[s], free[s + 1], free[s + 2], free[s + 3]
        y0 = work[STEP, j0]
        y1 = work[STEP, j1] - y0 * work[L + j1, s]
        y2 = work[STEP, j2] - y0 * work[L + j2, s] - y1 * work[L + j2, s + 1]
        y3 = work[STEP, j3] - y0 * work[L + j3, s] - y1 * work[L + j3, s + 1] - y2 * work[L + j3, s + 2]
        i0, i1 = work[INVERSE_PIVOT, s], work[INVERSE_PIVOT, s + 1]
        i2, i3 = work[INVERSE_PIVOT, s + 2], work[INVERSE_PIVOT, s + 3]
        _store_scalars(work, L + d, s, y0 * i0, y1 * i1, y2 * i2, y3 * i3)
        v = P + ld + s
        work[v, d], work[v + 1, d], work[v + 2, d], work[v + 3, d] = y0, y1, y2, y3
        m0, m1, m2, m3 = splat8(y0), splat8(y1), splat8(y2), splat8(y3)
        for b in range(j0 & ~7, ld, 8):
            a = fnma(load(work, v, b) * i0, m0, load(work, STEP, b))
            a = fnma(load(work, v + 1, b) * i1, m1, a)
            a = fnma(load(work, v + 2, b) * i2, m2, a)
            store(work, STEP, b, fnma(load(work, v + 3, b) * i3, m3, a))
        s += 4
    return s


@compiled
def _eliminate(work, row, column, z, i):  # type: ignore[no-untyped-def]
    """Lane i of z is final: take its share out of the lanes before it."""
    return first_lanes(i, fnma(load(work, row, column), splat8(lane(z, i)), z), z)


@compiled
def back_substitute(work: Matrix, free: Integers, count: int, d: int) -> None:
    """Solve Lᵀ s = z (row d of L) and write the step s of the first ``count`` entries of ``free``, in order, to STEP."""
    L = P + 2 * work.shape[1]
    for b in range(0, count, 8):
        store(work, STEP, b, load(work, L + d, b))
    for b in range((count - 1) & ~7, -1, -8):
        a = load(work, STEP, b)
        if count > b + 4:
            for i in range(7, 3, -1):
                a = _eliminate(work, L + free[b + i], b, a, i)
        for i in range(3, 0, -1):
            a = _eliminate(work, L + free[b + i], b, a, i)
        store(work, STEP, b, a)
        for c in range(0, b, 8):
            a, e = load(work, STEP, c), splat8(0.0)
            for k in range(b, min(b + 8, count), 2):
                a = fnma(load(work, L + free[k], c), broadcast(work, STEP, k), a)
                e = fnma(load(work, L + free[k + 1], c), broadcast(work, STEP, k + 1), e)
            store(work, STEP, c, a + e)


@compiled
def gradient(work: Matrix, d: int) -> None:
    """G = Q + P X."""
    affine(work, P, d, X, Q, G)
