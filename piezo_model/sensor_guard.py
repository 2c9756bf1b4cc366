"""Which samples of a sensor can be learned from.

A sample is refused when it is not a number, lies far outside the range, or when the sensor is frozen: its value has not
changed at all while the drive moved by a noticeable share of its range. A jump of the output that the drive does not
explain (a plug pulled and put back, a re-zeroed sensor) refuses nothing by itself, but what was gathered before it does not fit
what comes after, so it is reported and whoever gathers starts anew.
"""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from solvers.compiled import kernel

Vector = NDArray[np.float64]
Flags = NDArray[np.int8]

PLAUSIBLE = 2.0
"""Largest output in unit amplitudes: half a range beyond either end."""
FROZEN_DRIVE = 0.05
"""Way of the drive, in unit amplitudes, over which the output must change at all."""
JUMP = 0.25
"""Change of the output from one sample to the next, in unit amplitudes, beyond four times that of the drive."""

LAST_X, LAST_Y, STILL = range(3)


class Verdict(IntEnum):
    """What the guard says of one sample."""

    GOOD = 0
    REFUSED = 1
    JUMPED = 2
    """Good, and not continuous with the one before."""


@kernel
def _judge(x: Vector, y: Vector, memory: Vector, verdicts: Flags) -> None:
    for k in range(x.size):
        verdict = 0
        if not (abs(y[k]) <= PLAUSIBLE):  # NaN compares false
            verdict = 1
        else:
            moved = abs(x[k] - memory[LAST_X]) if math.isfinite(memory[LAST_X]) else 0.0
            if y[k] == memory[LAST_Y]:
                memory[STILL] += moved
                if memory[STILL] > FROZEN_DRIVE:
                    verdict = 1
            else:
                memory[STILL] = 0.0
                if abs(y[k] - memory[LAST_Y]) > JUMP + 4.0 * moved:  # at the first sample this compares with NaN
                    verdict = 2
                memory[LAST_Y] = y[k]
        memory[LAST_X] = x[k]
        verdicts[k] = verdict


class SensorGuard:
    """The guard of one sensor; amplitudes are unit amplitudes of the structure.

    Examples
    --------
    >>> guard = SensorGuard()
    >>> x = np.array([0.0, 0.1, 0.2, 0.3])
    >>> guard.judge(x, np.array([0.0, 0.1, np.nan, 0.3])).tolist()
    [0, 0, 1, 0]
    """

    def __init__(self) -> None:
        self.memory = np.array([np.nan, np.nan, 0.0])

    def judge(self, x: Vector, y: Vector) -> Flags:
        """Verdicts (N,) on samples (N,), see :class:`Verdict`; the guard remembers the last one."""
        verdicts = np.empty(x.size, dtype=np.int8)
        _judge(x, y, self.memory, verdicts)
        return verdicts
