"""Which samples of a sensor can be learned from.

A sample is missing when it is not a finite number; nothing else follows from that. It is refused when it lies far outside the
range, or when the sensor is frozen: the output is to the last bit what it was while the drive went through a noticeable
share of its range. A jump is a change of the output that the drive since the last good sample does not explain (a plug pulled
and put back, a re-zeroed sensor): what was gathered before it need not fit what comes after. Refused samples and jumps are
faults, and whoever learns waits until samples have been good for a while.
"""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from solvers.compiled import inlined, kernel

Vector = NDArray[np.float64]
Flags = NDArray[np.int8]

PLAUSIBLE = 4.0
"""Largest output in unit amplitudes: a range given half as wide as it is must not be for ever."""
FROZEN_DRIVE = 0.02
"""Part of the drive, in unit amplitudes (1 % of its range), in which the output must change at all: an actuator has about half
its mean slope after a turning point, so the converter may be as coarse as 0.5 % of the range."""
JUMP = 0.25
"""Change of the output since the last good sample, in unit amplitudes, beyond FOLLOWING times the way of the drive."""
FOLLOWING = 4.0

LAST_X, LAST_Y, WAY, X_LOW, X_HIGH = range(5)
"""The last drive; the last good output; the way of the drive since; its lowest and highest since the output changed."""


class Verdict(IntEnum):
    """What the guard says of one sample."""

    GOOD = 0
    MISSING = 1
    REFUSED = 2
    JUMPED = 3


GOOD, MISSING, REFUSED, JUMPED = (int(verdict) for verdict in Verdict)


def fresh_memory() -> Vector:
    """Memory of a guard that has seen nothing."""
    return np.array([math.nan, math.nan, 0.0, math.nan, math.nan])


@inlined
def judge_step(memory: Vector, x: float, y: float) -> int:
    """Verdict on one sample in unit amplitudes."""
    if math.isfinite(memory[LAST_X]):
        memory[WAY] += abs(x - memory[LAST_X])
        memory[X_LOW], memory[X_HIGH] = min(memory[X_LOW], x), max(memory[X_HIGH], x)
    else:
        memory[X_LOW] = memory[X_HIGH] = x
    memory[LAST_X] = x
    verdict = GOOD
    if not math.isfinite(y):
        verdict = MISSING
    elif abs(y) > PLAUSIBLE:
        verdict = REFUSED
    elif y == memory[LAST_Y]:
        if memory[X_HIGH] - memory[X_LOW] > FROZEN_DRIVE:
            verdict = REFUSED
    else:
        if abs(y - memory[LAST_Y]) > JUMP + FOLLOWING * memory[WAY]:  # at the first sample this compares with NaN
            verdict = JUMPED
        memory[LAST_Y], memory[WAY] = y, 0.0
        memory[X_LOW] = memory[X_HIGH] = x
    return verdict


@kernel
def _judge(memory: Vector, x: Vector, y: Vector, verdicts: Flags) -> None:
    for k in range(x.size):
        verdicts[k] = judge_step(memory, x[k], y[k])


class SensorGuard:
    """The guard of one sensor; amplitudes are unit amplitudes of the structure.

    Examples
    --------
    >>> guard = SensorGuard()
    >>> x = np.array([0.0, 0.1, 0.2, 0.3, 0.3])
    >>> guard.judge(x, np.array([0.0, 0.1, np.nan, 0.3, 4.5])).tolist()
    [0, 0, 1, 0, 2]
    """

    def __init__(self) -> None:
        self.memory = fresh_memory()

    def judge(self, x: Vector, y: Vector) -> Flags:
        """Verdicts (N,) on samples (N,), see :class:`Verdict`; the guard remembers what it needs of them."""
        verdicts = np.empty(x.size, dtype=np.int8)
        _judge(self.memory, x, y, verdicts)
        return verdicts
