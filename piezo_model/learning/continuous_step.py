"""One sample of continuous operation in compiled code: guard, exact optimum of a forgetting data basis, hand-over.

    reset   nothing is learned; the squared error (5) of the weights in use is summed up
    learn   P ← λ P + Ξ Ξᵀ, q ← λ q + Ξ x and the optimum after that (`solvers.kernels.swept_rows`)

Every interval the weights that are one interval old take the place of those in use if they have predicted the interval at least
as well. They are admissible, since the solver keeps them in their box. A hand-over rewrites the arrays of the inverse in
place (`inverse_model.set_weights`), so no sample waits for it.

Weights are handed over only while the drive of the last one to two half windows went through a part of its range that says
enough. Otherwise learning pauses too, once there has been a hand-over, and nothing is forgotten: the memory would fade and the
noise of the sensor take its place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_model.compensator import DriveLimits
from piezo_model.inverse_model import InverseArrays
from piezo_model.learning.events import CHECKPOINT, FAILED, FAULT, FIRST_HAND_OVER, LEARN, NONE, OVER, RESET
from piezo_model.learning.inlined_steps import advance, drive_step, hand_over_step, regressor_step
from piezo_model.learning.sensor_guard import GOOD, MISSING, judge_step
from piezo_model.regressors import RegressorArrays
from solvers.compiled import inlined, kernel
from solvers.kernels import swept_gram as swept
from solvers.kernels.box_data import OK
from solvers.kernels.swept_rows import take, write_answer
from solvers.vector8 import load8, splat8, sum8

Vector = NDArray[np.float64]
Integers = NDArray[np.int64]

PHASE, LEFT, RESET_LASTS, SAMPLE, HAND_OVERS, REFUSALS, VERDICTS = range(7)
"""Entries of the counts, as of `cyclic_step`; VERDICTS and the three after it say how often the guard said what."""
(INTERVAL, CHECKPOINTS, HALF_WINDOW, IN_HALF, ESTABLISHED, EXCITED, PREDICTED, REVERT, WAIT,
 COUNTS) = range(VERDICTS + 4, VERDICTS + 14)
"""Samples between hand-overs, between checkpoints and in half a window of excitation; samples in the present half; whether
weights have been handed over since learning began anew; whether the drive says enough; samples predicted in this interval;
whether the candidate takes the place of the weights in use at the end of the interval whatever it predicts; samples still to
be learned from before any hand-over."""

(OLD, NEW, LEVEL, SMOOTHING, PROBATION, LOW, HIGH, LOW_BEFORE, HIGH_BEFORE, EXCITATION, X_LOW, X_HIGH, Y_LOW, Y_HIGH,
 NUMBERS) = range(15)
"""Entries of the numbers: squared errors of the weights in use and of the coming ones in this interval; the mean squared error
of those in use, its smoothing factor, and its sum since the last fault; lowest and highest drive in this half window and the
one before; the range that excites enough; lowest and highest drive and output since the last checkpoint."""


class ContinuousArrays(NamedTuple):
    """What the kernels of this file read and write."""

    regressors: RegressorArrays
    limits: DriveLimits
    play: Vector
    creep: Vector
    row: Vector
    """(x, Ξ, x), so that (x, Ξ) and (Ξ, x) are both there."""
    guard: Vector
    counts: Integers
    numbers: Vector
    in_use: Vector
    """(1, v): its product with a row is the error (5)."""
    candidate: Vector
    weights: Vector
    """Room for a candidate in the order of ``InverseArrays.weights``."""
    middle: int
    """Index of the slope about zero among the slopes."""
    work: Vector
    iwork: Integers
    solver_numbers: Vector


@inlined
def error_of(v: Vector, row: Vector) -> float:
    """E = x + vᵀΞ."""
    total = splat8(0.0)
    for i in range(0, v.size, 8):
        total = total + load8(v, i) * load8(row, i)
    return sum8(total)


@kernel
def hand_over(c: ContinuousArrays, inverse: InverseArrays, play: Vector, creep: Vector, fade: Vector) -> None:
    """Put the candidate in the place of the weights in use."""
    for i in range(c.in_use.size):
        c.in_use[i] = c.candidate[i]
    first, last, middle = c.regressors.n + 1, c.regressors.n + inverse.zones, c.regressors.n + 1 + c.middle
    for i in range(c.weights.size - 1):
        c.weights[i] = c.candidate[i]
    for i in range(first, last + 1):  # from slopes to weights
        if i > middle:
            c.weights[i] = c.candidate[i] - c.candidate[i - 1]
        elif i < middle:
            c.weights[i] = c.candidate[i] - c.candidate[i + 1]
    c.weights[c.weights.size - 1] = c.candidate[c.weights.size - 1] if c.regressors.offset else 0.0
    hand_over_step(inverse, c.limits, c.weights, play, creep, fade)


@inlined
def excited(c: ContinuousArrays, x: float) -> bool:
    """Whether the drive of this half window and the one before says enough; takes x into account."""
    n = c.numbers
    n[LOW], n[HIGH] = min(n[LOW], x), max(n[HIGH], x)
    c.counts[IN_HALF] += 1
    enough = max(n[HIGH], n[HIGH_BEFORE]) - min(n[LOW], n[LOW_BEFORE]) >= n[EXCITATION]
    if c.counts[IN_HALF] >= c.counts[HALF_WINDOW]:
        n[LOW_BEFORE], n[HIGH_BEFORE] = n[LOW], n[HIGH]
        n[LOW] = n[HIGH] = x
        c.counts[IN_HALF] = 0
    return enough


@inlined
def learn_step(c: ContinuousArrays, error: float, y: float) -> int:
    """Take the row of this sample."""
    n, x = c.numbers, c.row[c.regressors.width]
    n[X_LOW], n[X_HIGH] = min(n[X_LOW], x), max(n[X_HIGH], x)
    n[Y_LOW], n[Y_HIGH] = min(n[Y_LOW], y), max(n[Y_HIGH], y)
    other = error_of(c.candidate, c.row)
    c.numbers[OLD] += error * error
    c.numbers[NEW] += other * other
    c.counts[PREDICTED] += 1
    c.counts[WAIT] -= 1 if c.counts[WAIT] > 0 else 0
    c.numbers[LEVEL] += c.numbers[SMOOTHING] * (error * error - c.numbers[LEVEL])
    status = take(c.work, c.iwork, c.solver_numbers, c.row, 1)
    return NONE if status == OK else FAILED


@kernel
def end_interval(c: ContinuousArrays, inverse: InverseArrays, play: Vector, creep: Vector, fade: Vector) -> int:
    """Compare the weights in use with the candidate, hand over, and choose the next candidate."""
    signal = NONE
    if c.counts[REVERT] != 0:
        hand_over(c, inverse, play, creep, fade)
        c.counts[REVERT], c.counts[LEFT], c.numbers[PROBATION] = 0, c.counts[RESET_LASTS], 0.0
    elif c.counts[PREDICTED] > 0:
        better = c.numbers[NEW] <= c.numbers[OLD]  # NaN compares false
        if better and c.counts[EXCITED] != 0 and c.counts[WAIT] == 0:
            hand_over(c, inverse, play, creep, fade)
            c.counts[HAND_OVERS] += 1
            if c.counts[ESTABLISHED] == 0:
                c.counts[ESTABLISHED], signal = 1, FIRST_HAND_OVER
        elif not better:
            c.counts[REFUSALS] += 1
        write_answer(c.work, c.iwork)
        for i in range(c.iwork[swept.SIZE]):
            c.candidate[1 + i] = c.work[swept.ANSWER * c.iwork[swept.LEADING] + i]
    c.numbers[OLD] = c.numbers[NEW] = 0.0
    c.counts[PREDICTED] = 0
    if signal == NONE and c.counts[PHASE] == LEARN and c.counts[SAMPLE] % c.counts[CHECKPOINTS] == 0:
        signal = CHECKPOINT
    return signal


@inlined
def continuous_step(c: ContinuousArrays, inverse: InverseArrays, play: Vector, creep: Vector, fade: Vector, x: float,
                    y: float) -> int:
    """Take the output y that the drive x produced; returns a `learning_events.Signal`."""
    unit_x, unit_y = (x - c.limits.x_centre) / c.limits.x_scale, (y - c.limits.y_centre) / c.limits.y_scale
    verdict = judge_step(c.guard, unit_x, unit_y)
    c.counts[VERDICTS + verdict] += 1
    c.counts[SAMPLE] += 1
    phase, signal = c.counts[PHASE], NONE
    if verdict == GOOD:
        regressor_step(c.regressors, unit_x, unit_y, c.play, c.creep, c.row, 0)
        c.row[c.regressors.width] = unit_x
        error = error_of(c.in_use, c.row)
        if phase == RESET:
            c.numbers[PROBATION] += error * error
            c.counts[LEFT] -= 1
            signal = OVER if c.counts[LEFT] <= 0 else NONE
        else:
            c.counts[EXCITED] = 1 if excited(c, unit_x) else 0
            if c.counts[EXCITED] != 0 or c.counts[ESTABLISHED] == 0:
                signal = learn_step(c, error, unit_y)
    else:
        advance(c.regressors.operators, unit_x, c.play, c.creep)
        if verdict != MISSING:
            if phase == LEARN:
                signal = FAULT
            else:
                c.counts[LEFT], c.numbers[PROBATION] = c.counts[RESET_LASTS], 0.0
    if signal == NONE and c.counts[SAMPLE] % c.counts[INTERVAL] == 0:
        signal = end_interval(c, inverse, play, creep, fade)
    return signal


@kernel
def observe(c: ContinuousArrays, inverse: InverseArrays, play: Vector, creep: Vector, fade: Vector, x: Vector, y: Vector,
            first: int) -> tuple[int, int]:
    """Take samples from ``first`` on; returns how far it came, and the signal that it stopped at."""
    for k in range(first, x.size):
        signal = continuous_step(c, inverse, play, creep, fade, x[k], y[k])
        if signal != NONE:
            return k + 1, signal
    return x.size, NONE


@kernel
def drive_and_observe(c: ContinuousArrays, inverse: InverseArrays, play: Vector, creep: Vector, fade: Vector,
                      y_ref: Vector, y: Vector, x: Vector, first: int) -> tuple[int, int]:
    """The whole loop: x[k] for y_ref[k], then learn from what y[k] says that x[k] produced."""
    for k in range(first, x.size):
        x[k] = drive_step(inverse, c.limits, y_ref[k], play, creep, fade)
        signal = continuous_step(c, inverse, play, creep, fade, x[k], y[k])
        if signal != NONE:
            return k + 1, signal
    return x.size, NONE
