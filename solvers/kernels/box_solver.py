"""The box QP solver of two paths, as Python and compiled code call it.

New data are inverted (:mod:`solvers.kernels.box_inverse`) and solved by exchanges (:mod:`solvers.kernels.box_exchange`). What is
not safely positive definite, finite and symmetric, and what the exchanges do not bring to an end, goes to the
factorisation with its stricter rules (:mod:`solvers.kernels.box_data`, :mod:`solvers.kernels.box_pivoting`), which
decides. Which path a cold problem takes follows from its data alone, so the answer does too.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from solvers.array_object import matrix, vector
from solvers.compiled import compiled, kernel
from solvers.kernels.box_data import (
    ARRAY_CLASS,
    DUAL_STEPS,
    EXCHANGES,
    FACTORISED,
    FALLBACKS,
    INVERTED,
    OK,
    PROXIMAL_STEPS,
    SINGULAR,
    SIZE,
    STATE,
    factorise_copy,
    rescale,
    set_hessian,
    set_linear,
    start_from,
)
from solvers.kernels.box_exchange import exchange_all
from solvers.kernels.box_factor import ANSWER, Integers
from solvers.kernels.box_inverse import invert
from solvers.kernels.box_pivoting import solve_box
from solvers.kernels.forgetting import absorb
from solvers.nanoclock import monotonic_ns
from solvers.protocol import Matrix, Vector

LAYOUT = -1
"""What ``take_objects`` returns where P and q are not both contiguous float64 arrays of the size that was set up."""


@kernel
def take_objects(work: Matrix, iwork: Integers, hessian: Any, q: Any) -> int:
    """Take P and q as they come from Python; OK, LAYOUT or a key of ``box_data.REASONS``."""
    d, array_class = iwork[STATE, SIZE], iwork[STATE, ARRAY_CLASS]
    P, linear = matrix(hessian, array_class), vector(q, array_class)
    if P.shape[0] != d or P.shape[1] != d or linear.size != d:
        return LAYOUT
    return take(work, iwork, P, linear)


@compiled
def take(work: Matrix, iwork: Integers, hessian: Matrix, q: Vector) -> int:
    """Take P, shape (d, d), and q, shape (d,), both C-contiguous; OK or a key of ``box_data.REASONS``."""
    status = take_hessian(work, iwork, hessian)
    return status if status != OK else set_linear(work, iwork, q)


@compiled
def take_hessian(work: Matrix, iwork: Integers, hessian: Matrix) -> int:
    """Take P; q, bounds and sides stay."""
    if invert(work, iwork, hessian):
        rescale(work, iwork)
        iwork[STATE, FACTORISED], iwork[STATE, SINGULAR] = 0, 0
        return OK
    return set_hessian(work, iwork, hessian)


@kernel
def solve(work: Matrix, iwork: Integers, warm: bool) -> int:
    """Solve; the answer stands in ``work[ANSWER, :d]``. Returns OK or a key of ``box_data.REASONS``."""
    iwork[STATE, DUAL_STEPS], iwork[STATE, PROXIMAL_STEPS], iwork[STATE, EXCHANGES] = 0, 0, 0
    if iwork[STATE, INVERTED] and exchange_all(work, iwork, warm):
        return OK
    iwork[STATE, FALLBACKS] += 1
    if not iwork[STATE, FACTORISED]:
        status = factorise_copy(work, iwork)
        if status != OK:
            return status
    return solve_box(work, iwork, warm)


@compiled
def time_solves(work: Matrix, iwork: Integers, P: Matrix, q: Vector, warm: bool, x: Vector, updates: Integers,
                solves: Integers) -> int:
    """Take P and q anew and solve, from x (d,) if it is not empty, again and again, and note the time of each."""
    status, warm = OK, warm or x.size > 0
    for k in range(updates.size):
        start = monotonic_ns()
        status = take(work, iwork, P, q)
        between = monotonic_ns()
        if x.size > 0 and status == OK:
            status = start_from(work, iwork, x)
        status = solve(work, iwork, warm) if status == OK else status
        updates[k], solves[k] = between - start, monotonic_ns() - between
    return status


@compiled
def follow(work: Matrix, iwork: Integers, P: Matrix, q: Vector, rows: Matrix, forgetting: float, warm: bool,
           answers: Matrix, nanoseconds: Integers) -> int:
    """Take rows (ξ, x) into P and q, solve after each, warm from the last active set, and note the time of that."""
    d, c = q.size, np.zeros(1)
    for k in range(rows.shape[0]):
        absorb(P, q, c, rows, k, k + 1, forgetting)
        start = monotonic_ns()
        status = take(work, iwork, P, q)
        status = solve(work, iwork, warm) if status == OK else status
        nanoseconds[k] = monotonic_ns() - start
        if status != OK:
            return status
        answers[k] = work[ANSWER, :d]
    return OK
