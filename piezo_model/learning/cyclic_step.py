"""One sample of cyclic operation in compiled code: guard, data basis and one step of the solver.

    phase    with each sample                                                       over after
    reset    only the operator states move on                                       so many good samples without a fault
    build    counted into the data basis                                            so many good samples
    learn    one step w ← Proj(w − η (P w + q)), where the solver is one of steps   so many samples

The kernels come back at the end of a phase and at a fault while samples are counted; what follows is decided in
`cyclic_learning`. x and y are in the units of input and output.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_model.compensator import DriveLimits
from piezo_model.data_basis import BasisArrays
from piezo_model.inverse_model import InverseArrays
from piezo_model.learning.events import BUILD, FAULT, LEARN, NONE, OVER, RESET
from piezo_model.learning.inlined_steps import advance, count_step, drive_step
from piezo_model.learning.sensor_guard import GOOD, MISSING, judge_step
from solvers.compiled import inlined, kernel
from solvers.kernels.projected_step import run

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Integers = NDArray[np.int64]

PHASE, LEFT, RESET_LASTS, SAMPLE, HAND_OVERS, REFUSALS, VERDICTS = range(7)
"""Entries of the counts: the phase, samples left in it, length of a reset, samples so far, hand-overs and refusals; from
VERDICTS on, how often the guard said what."""


class SteppedSolver(NamedTuple):
    """Arguments of `solvers.kernels.projected_step.run`; ``d`` is 0 where the solver is not one of steps."""

    work: Matrix
    d: int
    A: Matrix
    b: Vector
    index: Integers  # type: ignore[assignment]
    dual: Matrix
    idual: NDArray[np.int64]


class CyclicArrays(NamedTuple):
    """What the kernels of this file read and write."""

    basis: BasisArrays
    limits: DriveLimits
    guard: Vector
    counts: Integers
    solver: SteppedSolver


@inlined
def cyclic_step(c: CyclicArrays, x: float, y: float) -> int:
    """Take the output y that the drive x produced; returns a `learning_events.Signal`."""
    unit_x, unit_y = (x - c.limits.x_centre) / c.limits.x_scale, (y - c.limits.y_centre) / c.limits.y_scale
    verdict = judge_step(c.guard, unit_x, unit_y)
    c.counts[VERDICTS + verdict] += 1
    c.counts[SAMPLE] += 1
    phase, signal = c.counts[PHASE], NONE
    if phase == BUILD and verdict == GOOD:
        count_step(c.basis, unit_x, unit_y)
    else:
        advance(c.basis.regressors.operators, unit_x, c.basis.play, c.basis.creep)
    if phase == LEARN:
        if c.solver.d > 0:
            run(c.solver.work, c.solver.d, 1, -1.0, c.solver.A, c.solver.b, c.solver.index, c.solver.dual, c.solver.idual)
        c.counts[LEFT] -= 1
    elif verdict == GOOD:
        c.counts[LEFT] -= 1
    elif verdict != MISSING:
        if phase == RESET:
            c.counts[LEFT] = c.counts[RESET_LASTS]
        else:
            signal = FAULT
    return OVER if signal == NONE and c.counts[LEFT] <= 0 else signal


@kernel
def observe(c: CyclicArrays, x: Vector, y: Vector, first: int) -> tuple[int, int]:
    """Take samples from ``first`` on; returns how far it came, and the signal that it stopped at."""
    for k in range(first, x.size):
        signal = cyclic_step(c, x[k], y[k])
        if signal != NONE:
            return k + 1, signal
    return x.size, NONE


@kernel
def drive_and_observe(c: CyclicArrays, inverse: InverseArrays, play: Vector, creep: Vector, fade: Vector, y_ref: Vector,
                      y: Vector, x: Vector, first: int) -> tuple[int, int]:
    """The whole loop: x[k] for y_ref[k], then learn from what y[k] says that x[k] produced."""
    for k in range(first, x.size):
        x[k] = drive_step(inverse, c.limits, y_ref[k], play, creep, fade)
        signal = cyclic_step(c, x[k], y[k])
        if signal != NONE:
            return k + 1, signal
    return x.size, NONE
