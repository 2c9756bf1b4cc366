"""P⁻¹ of the scaled data of a box QP, by sweeps in passes of two variables.

Swept on the variables F, with R the others, P becomes the symmetric matrix M with

    M_FF = −P_FF⁻¹,    M_FR = P_FF⁻¹ P_FR,    M_RR = P_RR − P_RF P_FF⁻¹ P_FR,

and sweeping two more, K ⊂ R, with H = M_KK⁻¹ and N all but K, is

    M_NN ← M_NN − M_NK H M_KN,    M_KN ← H M_KN,    M_KK ← −H.

On every variable, M = −P⁻¹. P is positive definite iff every H on the way is, and 1/λ_min(P) ≤ trace P⁻¹, which a triangular
factor does not show; a P that is not safely inside both is left to :mod:`solvers.kernels.box_data`.

Two pivots a pass halve the loads and stores of M (a store of eight doubles takes as long as two multiply-adds do) and
share one division, whose wait is filled by the last rows of the pass before: the rows of the next pair come first.

Sources: A. E. Beaton, The use of special matrix operators in statistical calculus, ETS RB-64-51, 1964; J. H. Goodnight, "A
tutorial on the SWEEP operator", American Statistician 33 (1979) 149.
"""

from __future__ import annotations

from solvers.compiled import compiled, inlined
from solvers.kernels.box_data import EPS, INVERTED, SIZE, STATE
from solvers.kernels.box_factor import (
    CURVATURE,
    INVERSE_DIAGONAL,
    INVERSE_WEIGHT,
    ONE,
    PIVOT_ROWS,
    SCALE,
    Integers,
    P,
    inverse_rows,
    skew_rows,
)
from solvers.kernels.vector import broadcast, fma, fnma, lane, load, load_first, max8, root_scale8, store
from solvers.protocol import Matrix
from solvers.vector8 import splat8, sum8

LARGEST = 1e9
"""Diagonal entry of P⁻¹, at unit diagonal of P, up to which two steps of refinement make an answer exact."""


@compiled
def invert(work: Matrix, iwork: Integers, hessian: Matrix) -> bool:
    """Take P, shape (d, d): its scale, a scaled copy and M.

    False where P is not finite, not symmetric to rounding or not safely positive definite: then ``set_hessian`` decides.
    """
    d = iwork[STATE, SIZE]
    iwork[STATE, INVERTED] = 0
    if not abs(_copy_scaled(work, hessian, d)) <= 0.5 * d * d * EPS:
        return False
    if not _sweep_all(work, d):
        return False
    M, longest = inverse_rows(work), splat8(0.0)
    for j in range(d):
        work[INVERSE_DIAGONAL, j] = work[M + j, j]
    for b in range(0, ((d + 7) & ~7), 8):
        diagonal = 0.0 - load(work, INVERSE_DIAGONAL, b)
        store(work, INVERSE_WEIGHT, b, 1.0 / diagonal)
        longest = max(longest, diagonal)
    if not max8(longest) <= LARGEST:
        return False
    iwork[STATE, INVERTED] = 1
    return True


@inlined
def _copy_scaled(work: Matrix, hessian: Matrix, d: int) -> float:
    """Scale, and S P S by rows; returns Σ K_ij (S P S)_ij."""
    width, total = (d + 7) & ~7, 0.0
    for j in range(d):
        work[CURVATURE, j] = hessian[j, j]
    for b in range(0, width, 8):
        store(work, SCALE, b, root_scale8(load(work, CURVATURE, b)))
    column = 0
    while column + 24 < width:
        total += _copy_blocks(work, hessian, d, column, 3)
        column += 24
    if column + 24 == width:
        total += _copy_blocks(work, hessian, d, column, 3)
    elif column + 16 == width:
        total += _copy_blocks(work, hessian, d, column, 2)
    else:
        total += _copy_blocks(work, hessian, d, column, 1)
    return total


@inlined
def _copy_blocks(work: Matrix, hessian: Matrix, d: int, column: int, blocks: int) -> float:
    """Up to three blocks of columns of S P S; the last one may reach beyond the end of ``hessian``."""
    ld, last = work.shape[1], 8 * blocks - 8
    s0, s1, s2 = load(work, SCALE, column), load(work, SCALE, column + 8), load(work, SCALE, column + last)
    total_0, total_1, total_2 = splat8(0.0), splat8(0.0), splat8(0.0)
    scale, source, target, weights = SCALE * ld, column, P * ld + column, skew_rows(work) * ld + column
    stop = target + d * ld
    while target < stop:
        s = broadcast(work, 0, scale)
        entries = load_first(hessian, 0, source + last, d - column - last) * (s * s2)
        store(work, 0, target + last, entries)
        total_2 = fma(entries, load(work, 0, weights + last), total_2)
        if blocks > 1:
            entries = load(hessian, 0, source) * (s * s0)
            store(work, 0, target, entries)
            total_0 = fma(entries, load(work, 0, weights), total_0)
        if blocks > 2:
            entries = load(hessian, 0, source + 8) * (s * s1)
            store(work, 0, target + 8, entries)
            total_1 = fma(entries, load(work, 0, weights + 8), total_1)
        scale, source, target, weights = scale + 1, source + d, target + ld, weights + ld
    return sum8(total_0 + total_1 + total_2)


@inlined
def _sweep_all(work: Matrix, d: int) -> bool:
    """M = −P⁻¹; False where a pivot is not positive."""
    ld, width, even, positive = work.shape[1], (d + 7) & ~7, (d + 1) & ~1, True
    source, M = P * ld, inverse_rows(work) * ld
    for k in range(0, even, 2):
        pivots = source + k * ld
        a, b, c = _number(work, pivots + k), _number(work, pivots + k + 1), _number(work, pivots + ld + k + 1)
        determinant = a * c - b * b
        positive = positive & (a > 0.0) & (determinant > 0.0)
        inverse = 1.0 / determinant
        h0, h1, h2 = c * inverse, -b * inverse, a * inverse
        if width > 24:  # the first columns of the pivot rows are new before the last ones are done
            for at in range(0, width, 8):
                store(work, PIVOT_ROWS, at, load(work, 0, pivots + at))
                store(work, PIVOT_ROWS + 1, at, load(work, 0, pivots + ld + at))
            pivots = PIVOT_ROWS * ld
        column = 0
        while column + 24 <= width:
            _pass(work, source, M, pivots, k, even, column, 3, h0, h1, h2)
            column += 24
        if column + 16 <= width:
            _pass(work, source, M, pivots, k, even, column, 2, h0, h1, h2)
        elif column + 8 <= width:
            _pass(work, source, M, pivots, k, even, column, 1, h0, h1, h2)
        source = M
    return positive


@inlined
def _number(work: Matrix, at: int) -> float:
    """The number at a place counted from the start of the array."""
    return lane(broadcast(work, 0, at), 0)


@inlined
def _pass(work: Matrix, source: int, target: int, pivots: int, k: int, even: int, column: int, blocks: int,
          h0: float, h1: float, h2: float) -> None:
    """Sweep up to three blocks of columns on the variables K = k, k + 1; all places counted from the start of the array.

    With M_KK − I in place of M_KK, H M_K: is I − H in the columns K, and these need no care: M_iK − M_iK (I − H) = M_iK H.
    """
    ld, last = work.shape[1], 8 * blocks - 8
    one, x_at, y_at = ONE * ld - k + column, pivots + column, pivots + ld + column
    x, y = load(work, 0, x_at) - load(work, 0, one), load(work, 0, y_at) - load(work, 0, one - 1)
    u0, v0 = fma(x, splat8(h0), y * h1), fma(x, splat8(h1), y * h2)
    x, y = load(work, 0, x_at + 8) - load(work, 0, one + 8), load(work, 0, y_at + 8) - load(work, 0, one + 7)
    u1, v1 = fma(x, splat8(h0), y * h1), fma(x, splat8(h1), y * h2)
    x, y = load(work, 0, x_at + last) - load(work, 0, one + last), load(work, 0, y_at + last) - load(work, 0, one + last - 1)
    u2, v2 = fma(x, splat8(h0), y * h1), fma(x, splat8(h1), y * h2)
    i, offset = k + 2, (k + 2) * ld + column  # the rows of the next pair first, round to those before k
    for _ in range(even - 2):
        if i >= even:
            i, offset = 0, column
        f, g, at, to = broadcast(work, 0, pivots + i), broadcast(work, 0, pivots + ld + i), source + offset, target + offset
        store(work, 0, to, fnma(g, v0, fnma(f, u0, load(work, 0, at))))
        if blocks > 2:
            store(work, 0, to + 8, fnma(g, v1, fnma(f, u1, load(work, 0, at + 8))))
        if blocks > 1:
            store(work, 0, to + last, fnma(g, v2, fnma(f, u2, load(work, 0, at + last))))
        i, offset = i + 1, offset + ld
    at = target + k * ld + column
    store(work, 0, at, u0 - load(work, 0, one))
    store(work, 0, at + ld, v0 - load(work, 0, one - 1))
    if blocks > 1:
        store(work, 0, at + last, u2 - load(work, 0, one + last))
        store(work, 0, at + ld + last, v2 - load(work, 0, one + last - 1))
    if blocks > 2:
        store(work, 0, at + 8, u1 - load(work, 0, one + 8))
        store(work, 0, at + ld + 8, v1 - load(work, 0, one + 7))
