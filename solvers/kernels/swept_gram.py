"""The optimum of a box QP carried along while its data grow by one row at a time.

    minimise ½ Σ_k w_k (zᵀξ_k + x_k)²  subject to  0 ≤ z ≤ width,      Gram Ĝ = Σ_k w_k (ξ_k, x_k)(ξ_k, x_k)ᵀ

With F the free and A the other variables (x among them, it is never freed), the Gram matrix *swept* on F is

    M_FF = −G_FF⁻¹,    M_FA = G_FF⁻¹ G_FA,    M_AA = G_AA − G_AF G_FF⁻¹ G_FA,

symmetric, and its last row is the answer: M_xF = −z_F and M_xA is the gradient at A. So z is optimal iff that row is ≤ 0
(and ≥ −width) at F and ≥ 0 at A. One more row ξ changes G by ξξᵀ, and M by a matrix of rank one as well (Sherman–Morrison
on each block):

    u = ξ_A − M[:, F] ξ_F,    σ = 1 + ξ_Fᵀ u_F,    M ← M + u uᵀ / σ.

Freeing or fixing variable j is one sweep, of rank one again, with p = M_jj:

    M ← M − M[:, j] M[j, :] / p  off row and column j,    M_jk ← M_jk / |p|,    M_jj ← −1 / p.

So a sample costs 2 (d + 1)² multiplications and no square root or division but one, a change of the active set half of
that, and the exact optimum is there after every sample. Forgetting is in the weights: row k enters with λ^(−k/2) and the
clock k starts anew at each refresh.

Rounding. Errors of M grow with the rows added, so every REFRESH rows M is swept afresh from the Gram matrix, which is
accumulated beside it, with the proximal term ρ ‖z − z_now‖² that keeps what the data do not determine where it is; the
answer is then refined once against the Gram matrix.

Sources: A. P. Dempster, Elements of Continuous Multivariate Analysis, 1969 (the sweep operator); R. W. Cottle, "Principal
pivoting method of quadratic programming", 1968; L. Ljung, System Identification, 1999, chapter 11 (recursive least squares).

Memory: ``work`` is one array of rows of length ld = d + 1 rounded up to a multiple of eight. First VECTORS rows, then ld
rows of M, then ld rows of the Gram matrix.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solvers.compiled import inlined, kernel
from solvers.nanoclock import monotonic_ns
from solvers.vector8 import load8, padded, splat8, store8, sum8

Vector = NDArray[np.float64]
Integers = NDArray[np.int64]

REFRESH = 256
"""Rows after which M is made anew."""

(ANSWER, ORIGIN, SIGN, WIDTH, SIDE, FREE, ROW, U, CENTRE, G_Z, LB, UB, VECTORS) = range(13)
"""Vectors at the head: the answer v in the user's variables; the bound that z is measured from and in which direction
(v = ORIGIN + SIGN · z); the distance to the other bound, NO_BOUND where there is none; SIDE, the sign with which the last
row of M must not be negative (−1 free, +1 at the bound, 0 unbounded or fixed); FREE, 1 at F and 0 at A; work space."""

(SIZE, LEADING, FREE_COUNT, SINCE_REFRESH, PIVOTS, REFRESHES, FREE_LIST) = range(7)
"""Entries of ``iwork``; the list of free variables follows."""

(FORGETTING, ROOT_GROWTH, ROW_WEIGHT, ROOT_WEIGHT, PROXIMAL, RHO, NUMBERS) = range(7)
"""Entries of ``numbers``: λ; λ^(−1/2); the weight that a new row has; the root of what the coming row enters with; share of
the mean diagonal that the proximal term has; that term as it is in M."""

NO_BOUND = 1e300
OK, SINGULAR, CYCLING = 0, 1, 2

NEGLIGIBLE = 1e-15
"""Share of the optimal cost below which what an exchange would gain is left alone."""


def allocate(d: int) -> tuple[Vector, Integers, Vector]:
    """Work arrays for d variables: doubles, integers, numbers."""
    ld = padded(d + 1)
    iwork = np.zeros(FREE_LIST + d + 1, dtype=np.int64)
    iwork[SIZE], iwork[LEADING] = d, ld
    return np.zeros((VECTORS + 2 * ld) * ld), iwork, np.zeros(NUMBERS)


@inlined
def list_free(work: Vector, iwork: Integers) -> None:
    """Renew the list of free variables."""
    ld, count = iwork[LEADING], 0
    for j in range(iwork[SIZE]):
        if work[FREE * ld + j] > 0.0:
            iwork[FREE_LIST + count] = j
            count += 1
    iwork[FREE_COUNT] = count


@kernel
def sweep(work: Vector, iwork: Integers, j: int) -> bool:
    """Sweep M on variable j, which frees or fixes it; False where the pivot is no good."""
    d, ld = iwork[SIZE], iwork[LEADING]
    M, u = VECTORS * ld, U * ld
    row = M + j * ld
    p = work[row + j]
    if not abs(p) > 1e-300:
        return False
    inverse, scale = 1.0 / p, 1.0 / abs(p)
    for b in range(0, ld, 8):
        store8(work, u + b, load8(work, row + b))
    for i in range(d + 1):
        factor = splat8(-work[u + i] * inverse)
        for at in range(0, ld, 8):
            store8(work, M + i * ld + at, load8(work, M + i * ld + at) + factor * load8(work, u + at))
    for b in range(0, ld, 8):
        store8(work, row + b, load8(work, u + b) * scale)
    for i in range(d + 1):
        work[M + i * ld + j] = work[u + i] * scale
    work[row + j] = -inverse
    return True


@inlined
def add_row(work: Vector, iwork: Integers) -> None:
    """M ← M + u uᵀ/σ and G ← G + ξξᵀ (upper triangle) for the weighted row ξ in ``work[ROW]``."""
    d, ld, count = iwork[SIZE], iwork[LEADING], iwork[FREE_COUNT]
    M, G, row, u = VECTORS * ld, (VECTORS + ld) * ld, ROW * ld, U * ld
    dot = splat8(0.0)
    for b in range(0, ld, 8):
        xi, free = load8(work, row + b), load8(work, FREE * ld + b)
        sum_0 = xi - free * xi
        sum_1 = sum_2 = sum_3 = splat8(0.0)
        t = 0
        while t + 3 < count:
            j0, j1 = iwork[FREE_LIST + t], iwork[FREE_LIST + t + 1]
            j2, j3 = iwork[FREE_LIST + t + 2], iwork[FREE_LIST + t + 3]
            sum_0 = sum_0 - splat8(work[row + j0]) * load8(work, M + j0 * ld + b)
            sum_1 = sum_1 - splat8(work[row + j1]) * load8(work, M + j1 * ld + b)
            sum_2 = sum_2 - splat8(work[row + j2]) * load8(work, M + j2 * ld + b)
            sum_3 = sum_3 - splat8(work[row + j3]) * load8(work, M + j3 * ld + b)
            t += 4
        while t < count:
            j0 = iwork[FREE_LIST + t]
            sum_0 = sum_0 - splat8(work[row + j0]) * load8(work, M + j0 * ld + b)
            t += 1
        total = (sum_0 + sum_1) + (sum_2 + sum_3)
        store8(work, u + b, total)
        dot = dot + free * xi * total
    inverse = 1.0 / (1.0 + sum8(dot))
    for i in range(d + 1):
        factor, weight = splat8(work[u + i] * inverse), splat8(work[row + i])
        for b in range(0, ld, 8):
            store8(work, M + i * ld + b, load8(work, M + i * ld + b) + factor * load8(work, u + b))
        for b in range(i & ~7, ld, 8):
            store8(work, G + i * ld + b, load8(work, G + i * ld + b) + weight * load8(work, row + b))


@inlined
def violated(work: Vector, iwork: Integers) -> bool:
    """Whether any entry of the last row of M has the wrong sign."""
    ld = iwork[LEADING]
    last = (VECTORS + iwork[SIZE]) * ld
    worst = splat8(0.0)
    for b in range(0, ld, 8):
        value = load8(work, last + b)
        worst = min(worst, min(load8(work, SIDE * ld + b) * value,
                               load8(work, FREE * ld + b) * (load8(work, WIDTH * ld + b) + value)))
    return sum8(worst) < 0.0


@kernel
def repair(work: Vector, iwork: Integers) -> int:
    """Exchange variables until z is optimal, the one that gains most first."""
    d, ld = iwork[SIZE], iwork[LEADING]
    M = VECTORS * ld
    last = M + d * ld
    for _ in range(20 * d + 20):
        chosen, over, most = -1, False, NEGLIGIBLE * abs(work[last + d])
        for j in range(d):
            value, side = work[last + j], work[SIDE * ld + j]
            below, above = -side * value, -(work[WIDTH * ld + j] + value) * work[FREE * ld + j]
            size = max(below, above)
            if size > 0.0:
                gain = size * size / abs(work[M + j * ld + j])
                if gain > most:
                    chosen, over, most = j, above > below, gain
        if chosen < 0:
            return OK
        if over:
            reflect(work, iwork, chosen)
        if not sweep(work, iwork, chosen):
            return SINGULAR
        work[FREE * ld + chosen] = 1.0 - work[FREE * ld + chosen]
        work[SIDE * ld + chosen] = -work[SIDE * ld + chosen]
        list_free(work, iwork)
        iwork[PIVOTS] += 1
    return CYCLING


@kernel
def reflect(work: Vector, iwork: Integers, j: int) -> None:
    """Measure the free variable j from its other bound: z_j ← width − z_j."""
    d, ld = iwork[SIZE], iwork[LEADING]
    M, G, width = VECTORS * ld, (VECTORS + ld) * ld, work[WIDTH * ld + j]
    work[ORIGIN * ld + j] += work[SIGN * ld + j] * width
    work[SIGN * ld + j] = -work[SIGN * ld + j]
    for i in range(d + 1):
        if i != j:
            work[M + i * ld + j], work[M + j * ld + i] = -work[M + i * ld + j], -work[M + j * ld + i]
    work[M + d * ld + j] -= width
    work[M + j * ld + d] -= width
    for i in range(d):  # G holds its upper triangle: entry (i, j) stands at (min, max)
        other = work[G + min(i, j) * ld + max(i, j)]
        work[G + i * ld + d] += width * other
    work[G + d * ld + d] += width * (2.0 * (work[G + j * ld + d] - width * work[G + j * ld + j])
                                     + width * work[G + j * ld + j])
    for i in range(d + 1):
        if i != j:
            at = G + min(i, j) * ld + max(i, j)
            work[at] = -work[at]


@kernel
def refresh(work: Vector, iwork: Integers, numbers: Vector) -> int:
    """Sweep M afresh from the Gram matrix, with the proximal term about the present z, and refine the answer."""
    d, ld = iwork[SIZE], iwork[LEADING]
    M, G, centre = VECTORS * ld, (VECTORS + ld) * ld, CENTRE * ld
    shrink = numbers[ROW_WEIGHT] / (numbers[ROOT_WEIGHT] * numbers[ROOT_WEIGHT])
    numbers[ROOT_WEIGHT] = np.sqrt(numbers[ROW_WEIGHT])
    for at in range(G, G + ld * ld, 8):
        store8(work, at, load8(work, at) * shrink)
    trace = 0.0
    for j in range(d):
        trace += work[G + j * ld + j]
        work[centre + j] = -work[M + d * ld + j] * work[FREE * ld + j]
    rho = numbers[PROXIMAL] * trace / d
    numbers[RHO] = rho
    for i in range(d + 1):
        for j in range(i, d + 1):
            work[M + i * ld + j] = work[G + i * ld + j]
    for j in range(d):
        work[M + j * ld + j] += rho
        work[M + j * ld + d] -= rho * work[centre + j]
    for i in range(d + 1):
        for j in range(i):
            work[M + i * ld + j] = work[M + j * ld + i]
    iwork[SINCE_REFRESH] = 0
    iwork[REFRESHES] += 1
    for t in range(iwork[FREE_COUNT]):
        if not sweep(work, iwork, iwork[FREE_LIST + t]):
            return SINGULAR
    refine(work, iwork, rho)
    return repair(work, iwork)


@kernel
def refine(work: Vector, iwork: Integers, rho: float) -> None:
    """One step of iterative refinement: z_F ← z_F − G_FF⁻¹ g_F, and the gradient at A from the Gram matrix."""
    d, ld = iwork[SIZE], iwork[LEADING]
    M, G, g, z = VECTORS * ld, (VECTORS + ld) * ld, G_Z * ld, U * ld
    last = M + d * ld
    for step in range(2):
        for j in range(d):
            work[z + j] = -work[last + j] * work[FREE * ld + j] if step == 0 else work[z + j]
        for i in range(d):
            total = work[G + i * ld + d] + rho * (work[z + i] - work[CENTRE * ld + i])
            for j in range(d):
                total += work[G + min(i, j) * ld + max(i, j)] * work[z + j]
            work[g + i] = total
        if step == 0:
            for i in range(d):
                if work[FREE * ld + i] > 0.0:
                    for j in range(d):
                        work[z + i] += work[M + i * ld + j] * work[g + j] * work[FREE * ld + j]
    for j in range(d):
        value = -work[z + j] if work[FREE * ld + j] > 0.0 else work[g + j]
        work[last + j] = value
        work[M + j * ld + d] = value


@inlined
def take(work: Vector, iwork: Integers, numbers: Vector, rows: Vector, at: int) -> int:
    """Take one row (ξ, x) of d + 1 numbers from ``rows[at:]`` and restore optimality."""
    d, ld = iwork[SIZE], iwork[LEADING]
    numbers[ROOT_WEIGHT] *= numbers[ROOT_GROWTH]
    weight = numbers[ROOT_WEIGHT]
    target = rows[at + d]
    for j in range(d):
        xi = rows[at + j]
        target += work[ORIGIN * ld + j] * xi
        work[ROW * ld + j] = weight * work[SIGN * ld + j] * xi
    work[ROW * ld + d] = weight * target
    add_row(work, iwork)
    iwork[SINCE_REFRESH] += 1
    status = OK
    if iwork[SINCE_REFRESH] >= REFRESH:
        status = refresh(work, iwork, numbers)
    elif violated(work, iwork):
        status = repair(work, iwork)
    return status


@inlined
def write_answer(work: Vector, iwork: Integers) -> None:
    """v = ORIGIN + SIGN · z, with z inside its box to the last bit."""
    ld = iwork[LEADING]
    last = (VECTORS + iwork[SIZE]) * ld
    for b in range(0, ld, 8):
        side = load8(work, SIDE * ld + b)
        z = load8(work, FREE * ld + b) * (0.0 - load8(work, last + b))
        z = min(max(z, (side * side - 1.0) * NO_BOUND), load8(work, WIDTH * ld + b))
        store8(work, ANSWER * ld + b, load8(work, ORIGIN * ld + b) + load8(work, SIGN * ld + b) * z)


@kernel
def begin(work: Vector, iwork: Integers, numbers: Vector, P: Vector, q: Vector) -> int:
    """Start from P (row by row) and q and the bounds in ``work``: every bounded variable at a bound, then exchanges."""
    d, ld = iwork[SIZE], iwork[LEADING]
    M, G = VECTORS * ld, (VECTORS + ld) * ld
    for at in range(M, G + ld * ld, 8):
        store8(work, at, splat8(0.0))
    for j in range(d):
        lb, ub = work[LB * ld + j], work[UB * ld + j]
        lower, upper = lb > -NO_BOUND, ub < NO_BOUND
        work[ORIGIN * ld + j] = lb if lower else (ub if upper else 0.0)
        work[SIGN * ld + j] = -1.0 if upper and not lower else 1.0
        work[WIDTH * ld + j] = ub - lb if lower and upper else NO_BOUND
        work[FREE * ld + j] = 0.0 if lower or upper else 1.0
        work[SIDE * ld + j] = 1.0 if (lower or upper) and lb < ub else 0.0
    for i in range(d):
        shifted = q[i]
        for j in range(d):
            shifted += P[i * d + j] * work[ORIGIN * ld + j]
        work[G + i * ld + d] = work[SIGN * ld + i] * shifted
        for j in range(i, d):
            work[G + i * ld + j] = work[SIGN * ld + i] * P[i * d + j] * work[SIGN * ld + j]
    numbers[ROOT_WEIGHT] = np.sqrt(numbers[ROW_WEIGHT])
    list_free(work, iwork)
    status = refresh(work, iwork, numbers)
    if status == OK:  # once more, with the proximal term about the answer
        status = refresh(work, iwork, numbers)
    write_answer(work, iwork)
    return status


@kernel
def take_rows(work: Vector, iwork: Integers, numbers: Vector, rows: Vector, answers: Vector, nanoseconds: Integers) -> int:
    """Take rows (ξ, x) of d + 1 numbers one after the other.

    The answer after each goes to ``answers`` (d numbers each) and the time that it took to ``nanoseconds``, where these
    have room for it.
    """
    d, ld = iwork[SIZE], iwork[LEADING]
    for k in range(rows.size // (d + 1)):
        start = monotonic_ns() if k < nanoseconds.size else 0
        status = take(work, iwork, numbers, rows, k * (d + 1))
        write_answer(work, iwork)
        if k < nanoseconds.size:
            nanoseconds[k] = monotonic_ns() - start
        if status != OK:
            return status
        if answers.size >= (k + 1) * d:
            for j in range(d):
                answers[k * d + j] = work[ANSWER * ld + j]
    return OK


@kernel
def time_begin(work: Vector, iwork: Integers, numbers: Vector, P: Vector, q: Vector, nanoseconds: Integers) -> int:
    """Start from the same P and q again and again and note the time of each."""
    status = OK
    for k in range(nanoseconds.size):
        start = monotonic_ns()
        status = begin(work, iwork, numbers, P, q)
        nanoseconds[k] = monotonic_ns() - start
    return status
