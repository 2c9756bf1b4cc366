"""The dual active set method for bounds, finite where block pivoting cycles.

Goldfarb & Idnani (Math. Programming 27 (1983) 1) keep every multiplier right and mend one violated bound at a time. For a
box their step needs no Schur complement: between the candidate (x, u) of the set A and the candidate (x', g') of
A ∪ {j} every quantity is linear, so u + t (g' − u), t ∈ [0, 1], is the path. If a multiplier reaches zero at t < 1, its bound is
let go there and the path bends; t = 1 is j at its bound and the other multipliers right. The dual objective strictly rises
with each bound pushed home (at most |A| bends come before), so no set returns.
"""

from __future__ import annotations

from solvers.compiled import compiled
from solvers.kernels.box_data import BREAKDOWN, DUAL_STEPS, ENDLESS, FIXED, FREE, LOWER, OK, SIDE, SIZE, STATE, UPPER
from solvers.kernels.box_factor import HI, LO, MULTIPLIER, G, Integers, X
from solvers.kernels.box_step import gradient_tolerance, list_free, move, newton
from solvers.protocol import Matrix


@compiled
def dual_active_set(work: Matrix, iwork: Integers) -> int:
    """Solve from the sides as they are, after a Newton step on them; OK, BREAKDOWN or ENDLESS."""
    d = iwork[STATE, SIZE]
    if not _free_wrong_signs(work, iwork):
        return BREAKDOWN
    for i in range(d):
        work[MULTIPLIER, i] = work[G, i]
    for _ in range(100 + 20 * d):
        pushed, worst = -1, 0.0
        for i in range(d):
            violation = max(work[LO, i] - work[X, i], work[X, i] - work[HI, i])
            if iwork[SIDE, i] == FREE and violation > worst:
                pushed, worst = i, violation
        if pushed < 0:
            return OK
        move(work, iwork, pushed, LOWER if work[X, pushed] < work[LO, pushed] else UPPER)
        work[MULTIPLIER, pushed] = 0.0
        let_go = pushed
        while let_go >= 0:
            iwork[STATE, DUAL_STEPS] += 1
            list_free(work, iwork)
            if not newton(work, iwork):
                return BREAKDOWN
            let_go, t = _first_to_vanish(work, iwork, pushed)
            for i in range(d):
                work[MULTIPLIER, i] += t * (work[G, i] - work[MULTIPLIER, i])
            if let_go >= 0:
                iwork[SIDE, let_go] = FREE
                work[MULTIPLIER, let_go] = 0.0
    return ENDLESS


@compiled
def _free_wrong_signs(work: Matrix, iwork: Integers) -> bool:
    """Free bounds whose multiplier has the wrong sign until none has; at the latest, when no bound is left."""
    d = iwork[STATE, SIZE]
    while True:
        freed, tolerance = 0, gradient_tolerance(work, d)
        for i in range(d):
            side = iwork[SIDE, i]
            if side != FIXED and side * work[G, i] > tolerance:
                iwork[SIDE, i] = FREE
                freed += 1
        if freed == 0:
            return True
        list_free(work, iwork)
        if not newton(work, iwork):
            return False


@compiled
def _first_to_vanish(work: Matrix, iwork: Integers, pushed: int) -> tuple[int, float]:
    """The bound whose multiplier is zero first on the way to the candidate, and where; (−1, 1) if none is."""
    d = iwork[STATE, SIZE]
    tolerance = gradient_tolerance(work, d)
    let_go, length = -1, 1.0
    for i in range(d):
        side, u, g = iwork[SIDE, i], work[MULTIPLIER, i], work[G, i]
        if i != pushed and side != FIXED and side * g > tolerance:
            t = max(u / (u - g), 0.0)
            if let_go < 0 or t < length:
                let_go, length = i, t
    return let_go, length
