"""One Newton step on the free variables of a box QP, which every active set method here repeats.

With F free and A at a bound, P_FF s = −g_F, x_F ← x_F + s, g = q + P x. Since it starts from the current x, a second step
on the same set is a step of iterative refinement, and rounding of earlier sets does not pile up.
"""

from __future__ import annotations

from solvers.compiled import compiled
from solvers.kernels.box_data import COUNT, EPS, FIRST, FREE, LIST, LOWER, SIDE, SIZE, STATE, SYSTEMS, finish_list
from solvers.kernels.box_factor import HI, LO, STEP, G, Integers, P, Q, X, back_substitute, factorise, gradient
from solvers.kernels.vector import fma, load, store
from solvers.protocol import Matrix
from solvers.vector8 import splat8


@compiled
def newton(work: Matrix, iwork: Integers) -> bool:
    """Move x_F to the minimiser with x_A held, and g with it; False where P_FF is not positive definite to rounding."""
    d, count, ld = iwork[STATE, SIZE], iwork[STATE, COUNT], work.shape[1]
    free = iwork[LIST]
    iwork[STATE, SYSTEMS] += 1
    for b in range(0, ld, 8):
        store(work, STEP, b, 0.0 - load(work, G, b))
    for k in range(count):
        work[P + free[k], d] = -work[G, free[k]]
    if not factorise(work, free, d, iwork[STATE, FIRST]) > 0.0:
        iwork[STATE, FIRST] = 0
        return False
    iwork[STATE, FIRST] = ld
    back_substitute(work, free, (count + 3) & ~3, d)
    for k in range(count):
        work[X, free[k]] += work[STEP, k]
    gradient(work, d)
    return True


@compiled
def list_free(work: Matrix, iwork: Integers) -> None:
    """List the free variables in ascending order and note the first that differs from the list before."""
    d, ld = iwork[STATE, SIZE], work.shape[1]
    count, first = 0, iwork[STATE, FIRST]
    for j in range(d):
        if iwork[SIDE, j] == FREE:
            before = iwork[LIST, count]
            if before != j:
                first = min(first, j, before if before >= 0 else ld)
            iwork[LIST, count] = j
            count += 1
    iwork[STATE, COUNT] = count
    # Variables that stood here and after are gone; a unit column that stood here stands here again.
    before = iwork[LIST, count]
    iwork[STATE, FIRST] = min(first, before if 0 <= before < d else ld)
    finish_list(iwork, count)


@compiled
def move(work: Matrix, iwork: Integers, i: int, side: int) -> None:
    """Change the side of variable i; to a bound, x_i goes there and g follows."""
    iwork[SIDE, i] = side
    if side != FREE:
        bound = work[LO, i] if side == LOWER else work[HI, i]
        change = splat8(bound - work[X, i])
        work[X, i] = bound
        for b in range(0, work.shape[1], 8):
            store(work, G, b, fma(load(work, P + i, b), change, load(work, G, b)))


@compiled
def gradient_tolerance(work: Matrix, d: int) -> float:
    """What rounding may leave of an entry of g that is zero: 4 d ε max(|q|, |x|) in scaled variables."""
    q, x = 0.0, 0.0
    for i in range(d):
        q, x = max(q, abs(work[Q, i])), max(x, abs(work[X, i]))
    return 4 * d * EPS * max(q, x)
