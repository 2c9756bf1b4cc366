"""The swept Gram matrix made anew: on the set of free variables as it is, or from a cold exact solve.

Rounding errors of M grow with the rows added to it (:mod:`solvers.kernels.swept_rows` says when they are not let grow further).
G, to which rows are added and nothing else, has errors of its last bits only. So M is swept afresh from

    G + diag(ρ),    ρ_j (z_j − c_j)²/2 the proximal term about c, the z of now,

and its last row m, which is z and the gradient, takes steps of iterative refinement from where it was:

    m_A ← g_A,    m ← m − Σ_{j ∈ F} g_j M[j, :],    g = q + (G + diag ρ) z − diag(ρ) c.

What the data do not determine thus stays where it is. ρ_j is ``proximal`` times G_jj, at most the mean diagonal of G, and that
where G_jj = 0: a variable on a large scale must not hold those on a small one. Where G_FF is singular to rounding even so,
or the exchanges afterwards do not end, M is made anew with ρ_j at least FLOOR · G_jj.

If the exchanges do not end even so, :func:`recover` hands P and q, read back from G, to the cold exact solver
(:mod:`solvers.kernels.box_pivoting`, which knows when a problem is unbounded) and M is swept on its active set; so every
start begins too. What is left as an error is a problem that has no minimum: unbounded, or P indefinite.

Sources: N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002, chapter 12 (iterative refinement);
R. T. Rockafellar, SIAM J. Control Optim. 14 (1976) 877 (proximal point).
"""

from __future__ import annotations

import numpy as np

from solvers.compiled import compiled, kernel
from solvers.kernels.box_data import ENDLESS, OK, UNBOUNDED, UPPER, set_hessian, set_linear, start_from
from solvers.kernels.box_data import FREE as AT_NO_BOUND
from solvers.kernels.box_data import SIDE as BOX_SIDE
from solvers.kernels.box_pivoting import solve_box
from solvers.kernels.swept_exchange import exchange
from solvers.kernels.swept_gram import (
    ANSWER,
    CENTRE,
    COLD_STARTS,
    FREE,
    G_Z,
    LB,
    LEADING,
    NO_BOUND,
    ORIGIN,
    PIVOTS,
    PROXIMAL,
    REFRESHES,
    RHO,
    ROOT_WEIGHT,
    ROW_WEIGHT,
    SIDE,
    SIGN,
    SINCE_REFRESH,
    SINGULAR,
    SIZE,
    SURPRISE,
    UB,
    VECTORS,
    WIDTH,
    Integers,
    Vector,
    complete,
    list_free,
    subtract_free,
    sweep_free,
)
from solvers.protocol import Matrix
from solvers.vector8 import load8, store8

FLOOR = 1e-11
"""Of ρ_j/G_jj where G_FF is singular."""
SETTLED, RESOLVED, TOLERATED = 1e-3, 1e-24, 1e-14
"""Refinement ends where a step gains less than SETTLED times the one before, or RESOLVED times the cost; G_FF counts as singular
where that is still more than TOLERATED times the cost, or 1e-4 of what z = 0 costs."""
SPENT = 1e5
"""What ``numbers[SURPRISE]`` begins with where G_FF is singular: its inverse has few digits to lose."""
UNSEEN = 1e-200
"""ρ_j where the data say nothing on variable j, whatever their scale."""


@kernel
def refresh(work: Vector, iwork: Integers, numbers: Vector) -> int:
    """Make M anew with the proximal term about the present z, refine z and exchange; OK, SINGULAR or CYCLING."""
    d, ld = iwork[SIZE], iwork[LEADING]
    last, G = (VECTORS + d) * ld, (VECTORS + ld) * ld
    unwind(work, iwork, numbers)
    for b in range(0, ld, 8):
        store8(work, CENTRE * ld + b, 0.0 - load8(work, last + b))
    status = SINGULAR
    for floor in (0.0, FLOOR):
        for b in range(0, ld, 8):
            store8(work, CENTRE * ld + b, load8(work, FREE * ld + b) * load8(work, CENTRE * ld + b))
        status = factorise(work, iwork, numbers, floor)
        exchanges = -1
        while status == OK and exchanges != iwork[PIVOTS]:
            exchanges, wrong = iwork[PIVOTS], refine(work, iwork)
            for _ in range(3):
                before, wrong = wrong, refine(work, iwork)
                if not wrong > max(SETTLED * before, RESOLVED * abs(work[last + d])):
                    break
            if floor == 0.0 and not wrong <= TOLERATED * max(abs(work[last + d]), 1e-4 * work[G + d * ld + d]):
                status = SINGULAR
            else:
                status = exchange(work, iwork)
        if status == OK:
            return OK
    return status


@kernel
def unwind(work: Vector, iwork: Integers, numbers: Vector) -> None:
    """Multiply G so that the coming row enters with its own weight, and fill in its lower triangle."""
    d, ld = iwork[SIZE], iwork[LEADING]
    G, shrink = (VECTORS + ld) * ld, numbers[ROW_WEIGHT] / (numbers[ROOT_WEIGHT] * numbers[ROOT_WEIGHT])
    numbers[ROOT_WEIGHT] = np.sqrt(numbers[ROW_WEIGHT])
    for i in range(d + 1):
        for b in range(i & ~7, ld, 8):
            store8(work, G + i * ld + b, load8(work, G + i * ld + b) * shrink)
    complete(work, iwork, G)


@kernel
def factorise(work: Vector, iwork: Integers, numbers: Vector, floor: float) -> int:
    """Sweep M on F from G + diag(ρ) and q − ρ c; the last row is left at z = c. OK or SINGULAR."""
    d, ld = iwork[SIZE], iwork[LEADING]
    M, G, centre = VECTORS * ld, (VECTORS + ld) * ld, CENTRE * ld
    iwork[SINCE_REFRESH], numbers[SURPRISE] = 0, 1.0 if floor == 0.0 else SPENT
    iwork[REFRESHES] += 1
    trace = 0.0
    for j in range(d):
        trace += work[G + j * ld + j]
    for at in range(0, (d + 1) * ld, 8):
        store8(work, M + at, load8(work, G + at))
    for j in range(d):
        diagonal = work[G + j * ld + j]
        rho = numbers[PROXIMAL] * (min(diagonal, trace / d) if diagonal > 0.0 else trace / d)
        if floor > 0.0:
            rho = max(rho, floor * diagonal, UNSEEN)
        work[RHO * ld + j] = rho
        work[M + j * ld + j] += rho
        work[M + j * ld + d] -= rho * work[centre + j]
        work[M + d * ld + j] -= rho * work[centre + j]
    if not sweep_free(work, iwork):
        return SINGULAR
    for j in range(d):
        if work[FREE * ld + j] > 0.0:
            work[M + d * ld + j] = work[M + j * ld + d] = -work[centre + j]
    return OK


@kernel
def refine(work: Vector, iwork: Integers) -> float:
    """One step of iterative refinement of the last row of M by the residual from G; twice what it lowers the cost by."""
    d, ld = iwork[SIZE], iwork[LEADING]
    M, G, g = VECTORS * ld, (VECTORS + ld) * ld, G_Z * ld
    last = M + d * ld
    for b in range(0, ld, 8):
        offset = load8(work, FREE * ld + b) * load8(work, last + b) + load8(work, CENTRE * ld + b)
        store8(work, g + b, load8(work, G + d * ld + b) - load8(work, RHO * ld + b) * offset)
    subtract_free(work, iwork, G, last, g)
    for b in range(0, ld, 8):
        free, m = load8(work, FREE * ld + b), load8(work, last + b)
        store8(work, last + b, free * m + (1.0 - free) * load8(work, g + b))
    subtract_free(work, iwork, M, g, last)
    gain = 0.0
    for j in range(d):
        gain += work[FREE * ld + j] * work[g + j] * (work[last + j] - work[M + j * ld + d])
        work[M + j * ld + d] = work[last + j]
    return gain


@compiled
def begin(work: Vector, iwork: Integers, numbers: Vector, cold: Matrix, sides: Integers, P: Matrix, q: Vector,
          constant: float, warm: bool) -> int:
    """Start from P (d, d), q (d,) and twice the constant of the cost, at the optimum that the cold solver finds.

    ``cold`` and ``sides`` are its work arrays, which hold the bounds; with ``warm`` it goes from the present answer. Returns OK
    or a key of ``box_data.REASONS``, and then nothing has changed.
    """
    d, ld = iwork[SIZE], iwork[LEADING]
    M, G = VECTORS * ld, (VECTORS + ld) * ld
    status = max(set_hessian(cold, sides, P), set_linear(cold, sides, q))
    if status != OK:
        return status
    status, resumed = ENDLESS, warm and start_from(cold, sides, work[ANSWER * ld:ANSWER * ld + d]) == OK
    if resumed:
        status = solve_box(cold, sides, resumed)
        resumed = status in (OK, UNBOUNDED)
    if not resumed:  # a variable, since Numba compiles everything anew for a constant
        status = solve_box(cold, sides, resumed)
    if status != OK:
        return status
    for j in range(d):
        side, lb, ub = sides[BOX_SIDE, j], work[LB * ld + j], work[UB * ld + j]
        lower, upper = lb > -NO_BOUND, ub < NO_BOUND
        from_above = upper and (side == UPPER or not lower)
        work[ORIGIN * ld + j] = ub if from_above else lb if lower else 0.0
        work[SIGN * ld + j] = -1.0 if from_above else 1.0
        work[WIDTH * ld + j] = ub - lb if lower and upper else NO_BOUND
        free = side == AT_NO_BOUND
        work[FREE * ld + j] = 1.0 if free else 0.0
        work[SIDE * ld + j] = (-1.0 if free else 1.0) if (lower or upper) and lb < ub else 0.0
        work[CENTRE * ld + j] = work[SIGN * ld + j] * (cold[ANSWER, j] - work[ORIGIN * ld + j]) if free else 0.0
    for at in range(M, G + ld * ld):
        work[at] = 0.0
    for i in range(d):
        shifted = q[i]
        for j in range(d):
            shifted += P[i, j] * work[ORIGIN * ld + j]
            work[G + i * ld + j] = work[SIGN * ld + i] * 0.5 * (P[i, j] + P[j, i]) * work[SIGN * ld + j]
        work[G + i * ld + d] = work[G + d * ld + i] = work[SIGN * ld + i] * shifted
        constant += work[ORIGIN * ld + i] * (q[i] + shifted)
    work[G + d * ld + d] = constant
    numbers[ROOT_WEIGHT] = np.sqrt(numbers[ROW_WEIGHT])
    list_free(work, iwork)
    if factorise(work, iwork, numbers, 0.0) != OK:
        factorise(work, iwork, numbers, FLOOR)
    refine(work, iwork)
    return OK


@compiled
def recover(work: Vector, iwork: Integers, numbers: Vector, cold: Matrix, sides: Integers, P: Matrix, q: Vector) -> int:
    """Begin anew from the data that G holds; P (d, d) and q (d,) are room for them."""
    d, ld = iwork[SIZE], iwork[LEADING]
    G, sign, origin = (VECTORS + ld) * ld, SIGN * ld, ORIGIN * ld
    unwind(work, iwork, numbers)
    constant = work[G + d * ld + d]
    for i in range(d):
        q[i] = work[sign + i] * work[G + i * ld + d]
        for j in range(d):
            P[i, j] = work[sign + i] * work[G + i * ld + j] * work[sign + j]
            q[i] -= P[i, j] * work[origin + j]
    for i in range(d):
        constant -= work[origin + i] * (q[i] + work[sign + i] * work[G + i * ld + d])
    iwork[COLD_STARTS] += 1
    warm = iwork[COLD_STARTS] > 0  # it is; a variable, since Numba compiles everything anew for a constant
    return begin(work, iwork, numbers, cold, sides, P, q, constant, warm)
