"""The exact minimiser of ½ xᵀP x + qᵀx over lb ≤ x ≤ ub by block principal pivoting.

A guess of which variables F are free and which A sit at a bound leaves one candidate (:func:`box_step.newton`). It is
the minimiser iff lb ≤ x_F ≤ ub, g_i ≥ 0 at lower and g_i ≤ 0 at upper bounds. Block principal pivoting (Júdice & Pires,
Computers & Operations Research 21 (1994) 587; Kim & Park, SIAM J. Sci. Comput. 33 (2011) 3261) exchanges every variable that
breaks this, all at once; from "all free" it takes three systems at d = 18 and eight at d = 60. It may cycle, so
where the number of broken conditions has not reached a new low for PATIENCE rounds, :mod:`box_dual` ends the search.
A bound has no tolerance; a multiplier below the rounding of g counts as zero, which is what keeps ties from cycling.

Singular P. Where a pivot of P or its smallest eigenvalue is below about 16 d ε, the problem solved has the term
½ δ |z − c|² more, in the scaled variables z (δ = 1e-11, diag P ∈ [½, 2)), and c moves to its answer until the
term is below the rounding of g (proximal point, Rockafellar, SIAM J. Control Optim. 14 (1976) 877). c starts at 0, or at the
warm start: along directions that P does not see, x stays where it was. P that has a pivot ≤ 0 even so is refused as
indefinite; an x that walks on at constant pace is taken to the next bound in its way, and where there is none the
problem is unbounded.

Examples
--------
>>> import numpy as np
>>> from solvers.kernels.box_data import OK, allocate, set_bounds, set_hessian, set_linear
>>> work, iwork = allocate(2)
>>> P, q = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([1.0, -4.0])
>>> set_hessian(work, iwork, P) == set_linear(work, iwork, q) == set_bounds(work, iwork, np.zeros(2), np.ones(2)) == OK
True
>>> solve_box(work, iwork, False) == OK, work[0, :2].tolist()
(True, [0.0, 1.0])
"""

from __future__ import annotations

import numpy as np

from solvers.compiled import compiled
from solvers.kernels.box_data import (
    BREAKDOWN,
    DUAL_STEPS,
    EPS,
    FIXED,
    FREE,
    INDEFINITE,
    LOWER,
    OK,
    PROXIMAL,
    PROXIMAL_STEPS,
    SIDE,
    SINGULAR,
    SIZE,
    STATE,
    SYSTEMS,
    UNBOUNDED,
    UPPER,
    WANTED,
    regularise,
)
from solvers.kernels.box_dual import dual_active_set
from solvers.kernels.box_factor import ANSWER, CENTRE, HI, LO, RAW_Q, SCALE, G, Integers, P, Q, X, gradient
from solvers.kernels.box_step import gradient_tolerance, list_free, move, newton
from solvers.kernels.product import affine_compensated
from solvers.protocol import Matrix

LARGE = 1e7
"""|x|/|q| from which the residual of the refinement needs twice the precision: the relative cost gap that a plain one
leaves is about d ε² (|x|/|q|)²."""
PATIENCE = 5
"""Rounds without a new low of broken conditions; 2 to 10 take as many systems on average, 5 has the shortest tail."""


@compiled
def solve_box(work: Matrix, iwork: Integers, warm: bool) -> int:
    """Solve; the answer stands in ``work[ANSWER, :d]``. Returns OK or a key of ``box_data.REASONS``.

    Cold, it starts with every variable free at 0 and the answer is a function of the data alone. Warm, it starts from
    the answer and the active set in the work arrays: the last ones, or those of :func:`box_data.start_from`.
    """
    d = iwork[STATE, SIZE]
    for i in range(d):
        x, side = 0.0, FREE
        if warm:
            x, side = work[ANSWER, i] / work[SCALE, i], iwork[SIDE, i]
        lo, hi = work[LO, i], work[HI, i]
        if lo == hi:
            side = FIXED
        elif side == FIXED or (side == LOWER and lo == -np.inf) or (side == UPPER and hi == np.inf):
            side = FREE
        work[X, i] = x if side == FREE else hi if side == UPPER else lo
        iwork[SIDE, i] = side
    iwork[STATE, SYSTEMS], iwork[STATE, DUAL_STEPS], iwork[STATE, PROXIMAL_STEPS] = 0, 0, 0
    list_free(work, iwork)
    status = BREAKDOWN
    if iwork[STATE, SINGULAR] == 0:
        gradient(work, d)
        status = _pivot(work, iwork)
        if status == BREAKDOWN and regularise(work, iwork) != OK:
            return INDEFINITE
    if status == BREAKDOWN:
        status = _proximal_point(work, iwork)
    for i in range(d):
        # Inside already, but for what rounding left the dual method.
        work[ANSWER, i] = work[SCALE, i] * max(min(work[X, i], work[HI, i]), work[LO, i])
    return status


@compiled
def _pivot(work: Matrix, iwork: Integers) -> int:
    """Block principal pivoting from the sides as they are, with x and g = q + P x in step."""
    d = iwork[STATE, SIZE]
    linear = 0.0
    for i in range(d):
        linear = max(linear, 4 * d * EPS * abs(work[Q, i]))
    best, patience, refined = d + 1, PATIENCE, 0
    while newton(work, iwork):
        tolerance = gradient_tolerance(work, d)
        broken, residual = _judge(work, iwork, tolerance)
        if broken == 0:
            large = tolerance > LARGE * linear
            if refined >= (2 if large else 1) or (not large and residual <= 0.125 * tolerance):
                return OK
            refined += 1
            if large:
                affine_compensated(work, P, d, X, Q, G)
            continue
        refined = 0
        patience = PATIENCE if broken < best else patience - 1
        best = min(best, broken)
        if patience == 0:
            return dual_active_set(work, iwork)
        for i in range(d):
            if iwork[WANTED, i] != iwork[SIDE, i]:
                move(work, iwork, i, iwork[WANTED, i])
        list_free(work, iwork)
    return BREAKDOWN


@compiled
def _judge(work: Matrix, iwork: Integers, tolerance: float) -> tuple[int, float]:
    """Write the side that each variable wants; return how many want another, and max |g_F|."""
    broken, residual = 0, 0.0
    for i in range(iwork[STATE, SIZE]):
        side, x, g = iwork[SIDE, i], work[X, i], work[G, i]
        outside = (UPPER if x > work[HI, i] else FREE) + (LOWER if x < work[LO, i] else FREE)
        held = side if side == FIXED or side * g <= tolerance else FREE
        wanted = outside if side == FREE else held
        iwork[WANTED, i] = wanted
        broken += 1 if wanted != side else 0
        residual = max(residual, abs(g) if side == FREE else 0.0)
    return broken, residual


@compiled
def _proximal_point(work: Matrix, iwork: Integers) -> int:
    """Solve the regularised problem again and again round its own answer."""
    d = iwork[STATE, SIZE]
    for i in range(d):
        work[CENTRE, i] = work[X, i]
    status, last = OK, np.inf
    for _ in range(20 + 2 * d):
        iwork[STATE, PROXIMAL_STEPS] += 1
        for i in range(d):
            work[Q, i] = work[RAW_Q, i] * work[SCALE, i] - PROXIMAL * work[CENTRE, i]
        list_free(work, iwork)
        gradient(work, d)
        status = _pivot(work, iwork)
        if status != OK:
            break
        length = 0.0
        for i in range(d):
            length = max(length, abs(work[X, i] - work[CENTRE, i]))
        rounding = gradient_tolerance(work, d)
        if PROXIMAL * length <= rounding:
            break
        reach = 0.0
        if 0.99 * last < length < 1.01 * last and PROXIMAL * length > 16 * rounding:
            reach = _reach(work, d, 1e-9 * length)
            if reach == np.inf:
                status = UNBOUNDED
                break
        for i in range(d):
            work[CENTRE, i], work[X, i] = work[X, i], work[X, i] + reach * (work[X, i] - work[CENTRE, i])
        for i in range(d):
            work[CENTRE, i] = work[X, i]
        last = length
    for i in range(d):
        work[Q, i] = work[RAW_Q, i] * work[SCALE, i]
    return status


@compiled
def _reach(work: Matrix, d: int, negligible: float) -> float:
    """How many times the last proximal step fits before it meets a bound."""
    reach = np.inf
    for i in range(d):
        v = work[X, i] - work[CENTRE, i]
        if abs(v) > negligible:
            reach = min(reach, ((work[HI, i] if v > 0.0 else work[LO, i]) - work[X, i]) / v)
    return reach
