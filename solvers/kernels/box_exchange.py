"""The exact minimiser of ½ xᵀP x + qᵀx over lb ≤ x ≤ ub by exchanges on P⁻¹, for a P that is safely positive definite.

With F free and A at a bound, M is P swept on F (:mod:`solvers.kernels.box_inverse`) and r holds −x_F and the gradient g_A.
Freeing or holding variable j, with p = M_jj and c = −g_j/p or −(bound − x_j)/p, is

    r ← r + M_j c  off j,    M ← M − M_j M_jᵀ / p  off row and column j,    M_jj ← −1/p.

The exchange that gains most, violation²/|M_jj|, comes first; from "all free" the number of exchanges is then seldom
more than the number of bounds that hold at the optimum. M is not rewritten: column j is made when it is needed, from M = −P⁻¹
and the columns of the exchanges before. To that end a variable at a bound is measured in units of its pivot, in which its
row stays as it was: M_t = M − Σ u uᵀ/p with u_j = 0 (u_j = p − unit where j is freed again), but for the entries M_jj at
bounds, which stand in a vector of their own.

Whether x is the minimiser is judged after a step of iterative refinement, x_F ← x_F − P_FF⁻¹ g_F, by g = q + P x itself. The
conditions hold to rounding: |g_F| ≤ d ε s/2 and a multiplier not beyond 4 d ε s on its wrong side, with s = max(|q|, |x|), and
no bound broken by so much that the exchange would gain more than (ε s)², which keeps ties from going back and forth; the
answer itself is inside its bounds to the last bit. Where a few steps do not bring that about,
:mod:`solvers.kernels.box_pivoting` takes over.

Source: R. W. Cottle, "The principal pivoting method of quadratic programming", in Mathematics of the Decision Sciences, AMS, 1968.
"""

from __future__ import annotations

import numpy as np

from solvers.compiled import compiled, inlined
from solvers.kernels.box_data import EPS, EXCHANGES, FREE, LOWER, SIDE, SIZE, STATE, SYSTEMS, UPPER
from solvers.kernels.box_factor import (
    ABOVE,
    ANSWER,
    AT,
    BELOW,
    DIAGONAL,
    FACTOR,
    GAIN,
    HI,
    INVERSE_DIAGONAL,
    INVERSE_WEIGHT,
    IS_FREE,
    LO,
    MASKED,
    PRESENT,
    SCALE,
    SHARE,
    UNIT,
    WEIGHT,
    ZERO,
    G,
    Integers,
    P,
    Q,
    R,
    X,
    column_rows,
    inverse_rows,
)
from solvers.kernels.box_pivoting import LARGE
from solvers.kernels.product import affine
from solvers.kernels.vector import broadcast, first_equal8, fma, fnma, load, max8, store, with_lane
from solvers.protocol import Matrix
from solvers.vector8 import splat8, sum8

STEPS = 4
"""Refinements within which the answer must meet the optimality conditions."""


@compiled
def exchange_all(work: Matrix, iwork: Integers, warm: bool) -> bool:
    """Solve from "all free" or, warm, from the sides in ``iwork``; False where it does not come to an end."""
    d, limit = iwork[STATE, SIZE], 2 * work.shape[1]
    width, count, steps, exact, negligible = (d + 7) & ~7, 0, 0, False, 0.0
    for b in range(0, limit, 8):
        store(work, FACTOR, b, splat8(0.0))
    top = _start(work, d, width)
    if warm:
        for j in range(d):
            side = iwork[SIDE, j]
            iwork[SIDE, j] = FREE
            if (side == LOWER and work[LO, j] > -np.inf) or (side == UPPER and work[HI, j] < np.inf):
                top = _exchange(work, iwork, width, j, side, count)
                count += 1
    else:
        for j in range(d):
            iwork[SIDE, j] = FREE
    while steps == 0 or top > negligible or not exact:
        while top > negligible and count < limit:
            j, side = _first_gaining(work, width, top), FREE
            if iwork[SIDE, j] == FREE:
                side = LOWER if work[BELOW, j] + work[R, j] > 0.0 else UPPER
            top = _exchange(work, iwork, width, j, side, count)
            count += 1
        if steps == STEPS or count == limit:
            _forget_columns(work, count)
            return False
        exact, top, negligible = _refine(work, d, width, count)
        steps += 1
    for b in range(0, width, 8):
        x = max(min(load(work, X, b), load(work, HI, b)), load(work, LO, b))
        store(work, ANSWER, b, load(work, SCALE, b) * x)
    iwork[STATE, EXCHANGES], iwork[STATE, SYSTEMS] = count, steps
    return True


@inlined
def _start(work: Matrix, d: int, width: int) -> float:
    """All free, at x = −P⁻¹ q; returns the largest gain."""
    affine(work, inverse_rows(work), d, Q, ZERO, X)
    most = splat8(0.0)
    for b in range(0, width, 8):
        r, below, above = 0.0 - load(work, X, b), load(work, LO, b), 0.0 - load(work, HI, b)
        store(work, R, b, r)
        store(work, BELOW, b, below)
        store(work, ABOVE, b, above)
        store(work, DIAGONAL, b, load(work, INVERSE_DIAGONAL, b))
        store(work, WEIGHT, b, load(work, INVERSE_WEIGHT, b))
        store(work, IS_FREE, b, load(work, PRESENT, b))
        store(work, AT, b, splat8(0.0))
        store(work, UNIT, b, splat8(1.0))
        most = max(most, _gain(work, b, r, below, above, load(work, INVERSE_WEIGHT, b)))
    return max8(most)


@inlined
def _gain(work, b, r, below, above, weight):  # type: ignore[no-untyped-def]
    """What exchanging each of eight variables gains, zero where its sign is right."""
    violation = max(max(below + r, above - r), 0.0)
    gain = violation * violation * weight
    store(work, GAIN, b, gain)
    return gain


@inlined
def _first_gaining(work: Matrix, width: int, top: float) -> int:
    """The variable whose exchange gains so much."""
    chosen = 0
    for b in range(0, width, 8):
        place = first_equal8(load(work, GAIN, b), top)
        chosen = b + place if place < 8 else chosen
    return chosen


@inlined
def _exchange(work: Matrix, iwork: Integers, width: int, j: int, side: int, count: int) -> float:
    """Bring variable j to a side that it is not on, as exchange number ``count``; returns the largest gain then."""
    M, U = inverse_rows(work), column_rows(work)
    p, r, inverse, unit = work[DIAGONAL, j], work[R, j], work[WEIGHT, j], work[UNIT, j]
    iwork[SIDE, j] = side
    lo, hi = work[LO, j], work[HI, j]
    if side == FREE:
        c = -r * inverse
        new_r, new_p, own = -(work[AT, j] + c * unit), -unit * unit * inverse, p - unit
        below, above = lo, -hi
        work[AT, j], work[IS_FREE, j], work[UNIT, j] = 0.0, 1.0, 1.0
    else:
        bound = lo if side == LOWER else hi
        new_r, new_p, own = bound + r, -p, 0.0
        c = new_r * inverse
        inverse = -inverse
        below, above = -np.inf if side == LOWER or lo == hi else 0.0, -np.inf if side == UPPER or lo == hi else 0.0
        work[AT, j], work[IS_FREE, j], work[UNIT, j] = bound, 0.0, -p
    b, most = 0, splat8(0.0)
    while b + 24 <= width:
        most = max(most, _exchange_blocks(work, M + j, U, b, 3, j, count, c, inverse, new_r, new_p, own, below, above))
        b += 24
    if b + 16 <= width:
        most = max(most, _exchange_blocks(work, M + j, U, b, 2, j, count, c, inverse, new_r, new_p, own, below, above))
    elif b + 8 <= width:
        most = max(most, _exchange_blocks(work, M + j, U, b, 1, j, count, c, inverse, new_r, new_p, own, below, above))
    work[FACTOR, count] = inverse
    return max8(most)


@inlined
def _exchange_blocks(work, row, U, b, blocks, j, count, c, inverse, new_r, new_p, own, below, above):  # type: ignore[no-untyped-def]
    """Up to three blocks of column j of the present M, and what follows from it; returns the gains, of which the largest."""
    last = b + 8 * blocks - 8
    u0, u1, u2 = load(work, row, b), load(work, row, b + 8), load(work, row, last)
    for k in range(0, count, 4):  # the factors from ``count`` on are zero
        s0 = broadcast(work, U + k, j) * broadcast(work, FACTOR, k)
        s1 = broadcast(work, U + k + 1, j) * broadcast(work, FACTOR, k + 1)
        s2 = broadcast(work, U + k + 2, j) * broadcast(work, FACTOR, k + 2)
        s3 = broadcast(work, U + k + 3, j) * broadcast(work, FACTOR, k + 3)
        u2 = _less(work, U + k, last, s0, s1, s2, s3, u2)
        if blocks > 1:
            u0 = _less(work, U + k, b, s0, s1, s2, s3, u0)
        if blocks > 2:
            u1 = _less(work, U + k, b + 8, s0, s1, s2, s3, u1)
    most = _exchange_block(work, u2, U + count, last, j, c, inverse, new_r, new_p, own, below, above)
    if blocks > 1:
        most = max(most, _exchange_block(work, u0, U + count, b, j, c, inverse, new_r, new_p, own, below, above))
    if blocks > 2:
        most = max(most, _exchange_block(work, u1, U + count, b + 8, j, c, inverse, new_r, new_p, own, below, above))
    return most


@inlined
def _less(work, k, b, s0, s1, s2, s3, u):  # type: ignore[no-untyped-def]
    even = fnma(load(work, k + 2, b), s2, fnma(load(work, k, b), s0, u))
    return even - fma(load(work, k + 3, b), s3, load(work, k + 1, b) * s1)


@inlined
def _exchange_block(work, u, target, b, j, c, inverse, new_r, new_p, own, below, above):  # type: ignore[no-untyped-def]
    r = with_lane(fma(u, splat8(c), load(work, R, b)), j - b, new_r)
    diagonal = with_lane(fnma(u * inverse, u, load(work, DIAGONAL, b)), j - b, new_p)
    weight = 1.0 / max(diagonal, 0.0 - diagonal)
    low, high = with_lane(load(work, BELOW, b), j - b, below), with_lane(load(work, ABOVE, b), j - b, above)
    store(work, R, b, r)
    store(work, DIAGONAL, b, diagonal)
    store(work, WEIGHT, b, weight)
    store(work, BELOW, b, low)
    store(work, ABOVE, b, high)
    store(work, target, b, with_lane(u, j - b, own))
    return _gain(work, b, r, low, high, weight)


@inlined
def _forget_columns(work: Matrix, count: int) -> None:
    """Zero what may not be finite, since columns from before are read with a factor of zero."""
    for k in range(column_rows(work), column_rows(work) + count):
        for b in range(0, work.shape[1], 8):
            store(work, k, b, splat8(0.0))


@inlined
def _refine(work: Matrix, d: int, width: int, count: int) -> tuple[bool, float, float]:
    """Refine x, renew r from it and g = q + P x; whether g_F is zero to rounding, the largest gain and what is none."""
    M, U = inverse_rows(work), column_rows(work)
    for b in range(0, width, 8):
        store(work, X, b, fnma(load(work, IS_FREE, b), load(work, R, b), load(work, AT, b)))
    affine(work, P, d, X, Q, G)
    for b in range(0, width, 8):
        store(work, MASKED, b, load(work, G, b) * load(work, IS_FREE, b))
    affine(work, M, d, MASKED, ZERO, GAIN)
    for k in range(count):
        total = splat8(0.0)
        for b in range(0, width, 8):
            total = fma(load(work, U + k, b), load(work, MASKED, b), total)
        work[SHARE, k] = sum8(total) * work[FACTOR, k]
    longest, linear = splat8(0.0), splat8(0.0)
    for b in range(0, width, 8):
        step, q = load(work, GAIN, b), load(work, Q, b)
        for k in range(count):
            step = fnma(load(work, U + k, b), broadcast(work, SHARE, k), step)
        x = fma(load(work, IS_FREE, b), step, load(work, X, b))
        longest, linear = max(longest, max(x, 0.0 - x)), max(linear, max(q, 0.0 - q))
        store(work, X, b, x)
    affine(work, P, d, X, Q, G)
    x_size, q_size = max8(longest), max8(linear)
    rounding = EPS * max(x_size, q_size)
    tolerance = 4 * d * rounding
    residual, total, most = splat8(0.0), splat8(0.0), splat8(0.0)
    for b in range(0, width, 8):
        g, free = load(work, G, b), load(work, IS_FREE, b)
        beyond = (g - max(min(g, tolerance), -tolerance)) * load(work, UNIT, b)
        masked = g * free
        residual = max(residual, max(masked, 0.0 - masked))
        total = total + g * load(work, PRESENT, b)
        r = (1.0 - free) * beyond - free * load(work, X, b)
        store(work, R, b, r)
        most = max(most, _gain(work, b, r, load(work, BELOW, b), load(work, ABOVE, b), load(work, WEIGHT, b)))
    exact = (max8(residual) <= 0.125 * tolerance) & (abs(sum8(total)) < np.inf) & (x_size <= LARGE * q_size or x_size == 0.0)
    return exact, max8(most), rounding * rounding
