"""The Gram matrix of data that grow by one row at a time, swept on the free variables of a box QP.

    minimise ½ Σ_k w_k (zᵀξ_k + x_k)²  subject to  0 ≤ z ≤ width,      Gram G = Σ_k w_k (ξ_k, x_k)(ξ_k, x_k)ᵀ

With F the free and A the other variables (x among them, it is never freed), the matrix *swept* on F is

    M_FF = −G_FF⁻¹,    M_FA = G_FF⁻¹ G_FA,    M_AA = G_AA − G_AF G_FF⁻¹ G_FA,

symmetric, and its last row is the answer: M_xF = −z_F and M_xA is the gradient at A. So z is optimal iff that row is ≤ 0
(and ≥ −width) at F and ≥ 0 at A. Here are the matrix and what moves it by a matrix of low rank: freeing or fixing
variable j is one sweep, with p = M_jj,

    M ← M − M[:, j] M[j, :] / p  off row and column j,    M_jk ← M_jk / |p|,    M_jj ← −1 / p.

:mod:`solvers.kernels.swept_exchange` sweeps until z is optimal, :mod:`solvers.kernels.swept_refresh` makes M anew and
:mod:`solvers.kernels.swept_rows` takes the rows.

Sources: A. P. Dempster, Elements of Continuous Multivariate Analysis, 1969 (the sweep operator); R. W. Cottle, "Principal
pivoting method of quadratic programming", 1968.

Memory: ``work`` is one array of rows of length ld = d + 1 rounded up to a multiple of eight, from a cache line on, since at
d = 60 vectors across two lines cost a third of the time. First VECTORS rows, then ld rows of M, then ld rows of G. A row adds
to G from the diagonal blocks of eight on only, and :func:`complete` fills in what is below where it is wanted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solvers.compiled import aligned, inlined, kernel
from solvers.vector8 import load8, padded, splat8, store8

Vector = NDArray[np.float64]
Integers = NDArray[np.int64]

(ANSWER, ORIGIN, SIGN, WIDTH, SIDE, FREE, ROW, CENTRE, RHO, G_Z, LB, UB, ROOT, U, U_1, U_2, U_3, VECTORS) = range(18)
"""Vectors at the head: the answer v in the user's variables; the bound that z is measured from and in which direction
(v = ORIGIN + SIGN · z); the distance to the other bound, NO_BOUND where there is none; SIDE, the sign with which the last
row of M must not be negative (−1 free, +1 at the bound, 0 unbounded or fixed); FREE, 1 at F and 0 at A; the weighted row; centre
and weights of the proximal term; the gradient; bounds of v; pivots and
rows of sweeps."""

(SIZE, LEADING, FREE_COUNT, SINCE_REFRESH, PIVOTS, REFRESHES, COLD_STARTS, FREE_LIST) = range(8)
"""Entries of ``iwork``; the list of free variables follows."""

(FORGETTING, ROOT_GROWTH, ROW_WEIGHT, ROOT_WEIGHT, PROXIMAL, SURPRISE, NUMBERS) = range(7)
"""Entries of ``numbers``: λ; λ^(−1/2); the weight that a new row has; the root of what the coming row enters with; share of
the diagonal that the proximal term has; the product of σ since M was made anew."""

NO_BOUND = 1e100
"""Bounds from here on are none."""
SINGULAR, CYCLING = 101, 102
"""What the kernels return beside the codes of :mod:`solvers.kernels.box_data`: a pivot is no good; the exchanges do not end."""

REFRESH = 256
"""Rows after which M is made anew."""
NEGLIGIBLE = 1e-15
"""Share of the optimal cost below which what an exchange would gain is left alone."""


def allocate(d: int) -> tuple[Vector, Integers, Vector]:
    """Work arrays for d variables: doubles, integers, numbers."""
    ld = padded(d + 1)
    iwork = np.zeros(FREE_LIST + d + 1, dtype=np.int64)
    iwork[SIZE], iwork[LEADING] = d, ld
    return aligned(VECTORS + 2 * ld, ld).reshape(-1), iwork, np.zeros(NUMBERS)


@inlined
def list_free(work: Vector, iwork: Integers) -> None:
    """Renew the list of free variables."""
    ld, count = iwork[LEADING], 0
    for j in range(iwork[SIZE]):
        if work[FREE * ld + j] > 0.0:
            iwork[FREE_LIST + count] = j
            count += 1
    iwork[FREE_COUNT] = count


@inlined
def subtract_free(work: Vector, iwork: Integers, matrix: int, share: int, out: int) -> None:
    """Subtract Σ_F work[share + j] · (row j of the matrix that begins at ``matrix``) from the vector at ``out``."""
    ld, count = iwork[LEADING], iwork[FREE_COUNT]
    for b in range(0, ld, 8):
        sum_0 = load8(work, out + b)
        sum_1 = sum_2 = sum_3 = splat8(0.0)
        t = 0
        while t + 3 < count:
            j0, j1 = iwork[FREE_LIST + t], iwork[FREE_LIST + t + 1]
            j2, j3 = iwork[FREE_LIST + t + 2], iwork[FREE_LIST + t + 3]
            sum_0 = sum_0 - splat8(work[share + j0]) * load8(work, matrix + j0 * ld + b)
            sum_1 = sum_1 - splat8(work[share + j1]) * load8(work, matrix + j1 * ld + b)
            sum_2 = sum_2 - splat8(work[share + j2]) * load8(work, matrix + j2 * ld + b)
            sum_3 = sum_3 - splat8(work[share + j3]) * load8(work, matrix + j3 * ld + b)
            t += 4
        while t < count:
            j0 = iwork[FREE_LIST + t]
            sum_0 = sum_0 - splat8(work[share + j0]) * load8(work, matrix + j0 * ld + b)
            t += 1
        store8(work, out + b, (sum_0 + sum_1) + (sum_2 + sum_3))


@kernel
def complete(work: Vector, iwork: Integers, matrix: int) -> None:
    """Fill in what is below the diagonal blocks of the matrix that begins at ``matrix``."""
    d, ld = iwork[SIZE], iwork[LEADING]
    for block in range(8, d + 1, 8):
        for b in range(0, block, 8):
            for i in range(block, min(block + 8, d + 1)):
                for j in range(b, b + 8):
                    work[matrix + i * ld + j] = work[matrix + j * ld + i]


@inlined
def sweep_row(work: Vector, iwork: Integers, j: int, u: int) -> float:
    """Keep row j at ``u`` and sweep it; returns 1/p."""
    ld = iwork[LEADING]
    row = VECTORS * ld + j * ld
    inverse = 1.0 / work[row + j]
    for b in range(0, ld, 8):
        value = load8(work, row + b)
        store8(work, u + b, value)
        store8(work, row + b, value * abs(inverse))
    work[row + j] = -inverse
    return inverse


@inlined
def follow(work: Vector, iwork: Integers, i: int, j: int, u: int, inverse: float) -> None:
    """Bring row i up to a sweep on j, given row j from before it at ``u`` and 1/p."""
    ld = iwork[LEADING]
    row, entry = VECTORS * ld + i * ld, work[u + i]
    factor = splat8(-entry * inverse)
    for b in range(0, ld, 8):
        store8(work, row + b, load8(work, row + b) + factor * load8(work, u + b))
    work[row + j] = entry * abs(inverse)


@inlined
def definite(work: Vector, iwork: Integers, j: int) -> bool:
    """Whether variable j, not swept so far, has a pivot above its rounding; it is what of G_jj the variables in F do not explain."""
    d, ld = iwork[SIZE], iwork[LEADING]
    whole = work[(VECTORS + ld + j) * ld + j] + work[RHO * ld + j]
    return bool(work[(VECTORS + j) * ld + j] > 1e-15 * d * whole)


@kernel
def sweep(work: Vector, iwork: Integers, j: int) -> None:
    """Sweep M on variable j, which frees or fixes it."""
    d, ld = iwork[SIZE], iwork[LEADING]
    u = U * ld
    inverse = sweep_row(work, iwork, j, u)
    for i in range(d + 1):
        if i != j:
            follow(work, iwork, i, j, u, inverse)


@kernel
def sweep_free(work: Vector, iwork: Integers) -> bool:
    """Sweep M, not swept so far, on all of F; False where G_FF is not positive definite to rounding.

    Four at a time, M ← M − Σ w wᵀ with w the row of a pivot over its root: M is then read and written a quarter as often.
    The four rows follow each other sweep by sweep; the others, whose columns of the same numbers are these rows, only
    above the diagonal.
    """
    d, ld, count = iwork[SIZE], iwork[LEADING], iwork[FREE_COUNT]
    M, u0, u1, u2, u3 = VECTORS * ld, U * ld, U_1 * ld, U_2 * ld, U_3 * ld
    for t in range(0, count, 4):
        four, first = min(4, count - t), FREE_LIST + t
        for b in range(0, 4 * ld, 8):
            store8(work, u0 + b, splat8(0.0))
        for s in range(four):
            j = iwork[first + s]
            for i in range(j & ~7):
                work[M + j * ld + i] = work[M + i * ld + j]
        for s in range(four):
            j, u = iwork[first + s], u0 + s * ld
            if not definite(work, iwork, j):
                return False
            inverse = sweep_row(work, iwork, j, u)
            for r in range(four):
                if r != s:
                    follow(work, iwork, iwork[first + r], j, u, inverse)
            work[ROOT * ld + s] = np.sqrt(inverse)
        for s in range(four):
            for b in range(0, ld, 8):
                store8(work, u0 + s * ld + b, load8(work, u0 + s * ld + b) * work[ROOT * ld + s])
            for r in range(four):
                work[u0 + s * ld + iwork[first + r]] = 0.0
        for b in range(0, ld, 8):
            w0, w1, w2, w3 = load8(work, u0 + b), load8(work, u1 + b), load8(work, u2 + b), load8(work, u3 + b)
            for i in range(min(b + 8, d + 1)):
                value = load8(work, M + i * ld + b) - w0 * work[u0 + i] - w1 * work[u1 + i]
                store8(work, M + i * ld + b, value - w2 * work[u2 + i] - w3 * work[u3 + i])
        for s in range(four):
            j = iwork[first + s]
            for i in range(min((j | 7) + 1, d + 1)):
                work[M + i * ld + j] = work[M + j * ld + i]
    complete(work, iwork, M)
    return True
