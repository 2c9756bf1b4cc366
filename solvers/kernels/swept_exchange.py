"""Exchanges between free variables and bounds until a box QP with a swept Gram matrix is at its optimum.

The last row of M is z and the gradient (:mod:`solvers.kernels.swept_gram`). A variable whose entry has the wrong sign is
exchanged, the one with the largest s²/|M_jj| first, s being what is wrong: half of that is what leaving the bound gains, or
what keeping it costs. The rule ends the search early but not for certain: it may cycle, and after LIMIT + d exchanges the
caller is told so.

Source: R. W. Cottle, "Principal pivoting method of quadratic programming", 1968.
"""

from __future__ import annotations

from solvers.compiled import inlined, kernel
from solvers.kernels.box_data import OK
from solvers.kernels.swept_gram import (
    CENTRE,
    CYCLING,
    FREE,
    LB,
    LEADING,
    NEGLIGIBLE,
    ORIGIN,
    PIVOTS,
    SIDE,
    SIGN,
    SINGULAR,
    SIZE,
    UB,
    VECTORS,
    WIDTH,
    Integers,
    Vector,
    complete,
    definite,
    list_free,
    sweep,
)
from solvers.vector8 import load8, splat8, store8, sum8

LIMIT = 20
"""Exchanges, d more, after which the search is given up; a row of a stream takes none or one."""


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
def exchange(work: Vector, iwork: Integers) -> int:
    """Exchange variables until z is optimal, the one that gains most first; OK, SINGULAR or CYCLING."""
    d, ld = iwork[SIZE], iwork[LEADING]
    M = VECTORS * ld
    last = M + d * ld
    for _ in range(LIMIT + d):
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
        free = work[FREE * ld + chosen] > 0.0
        if not (work[M + chosen * ld + chosen] < 0.0 if free else definite(work, iwork, chosen)):
            return SINGULAR
        sweep(work, iwork, chosen)
        work[FREE * ld + chosen] = 0.0 if free else 1.0
        work[SIDE * ld + chosen] = -work[SIDE * ld + chosen]
        list_free(work, iwork)
        iwork[PIVOTS] += 1
    return CYCLING


@kernel
def reflect(work: Vector, iwork: Integers, j: int) -> None:
    """Measure the free variable j from its other bound, z_j ← width − z_j: ξ_j changes sign, and x becomes x + width ξ_j."""
    d, ld = iwork[SIZE], iwork[LEADING]
    M, G, width = VECTORS * ld, (VECTORS + ld) * ld, work[WIDTH * ld + j]
    upper = work[SIGN * ld + j] > 0.0
    work[ORIGIN * ld + j] = work[(UB if upper else LB) * ld + j]
    work[SIGN * ld + j] = -work[SIGN * ld + j]
    work[CENTRE * ld + j] = width - work[CENTRE * ld + j]
    complete(work, iwork, G)
    for b in range(0, ld, 8):
        row = load8(work, G + j * ld + b)
        store8(work, G + d * ld + b, load8(work, G + d * ld + b) + width * row)
        store8(work, G + j * ld + b, 0.0 - row)
        store8(work, M + j * ld + b, 0.0 - load8(work, M + j * ld + b))
    for i in range(d + 1):
        entry = work[G + i * ld + j]
        work[G + i * ld + d] += width * entry
        work[G + i * ld + j] = -entry
        work[M + i * ld + j] = -work[M + i * ld + j]
    work[M + d * ld + j] -= width
    work[M + j * ld + d] -= width
