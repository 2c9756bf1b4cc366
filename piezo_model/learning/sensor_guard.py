"""Which samples of a sensor can be learned from; the rules stand in ``core/sensor_guard.h``."""

import math
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from piezo_model.core import bindings
from solvers.arrays import Vector

Verdicts = NDArray[np.int64]


class Verdict(IntEnum):
    """What the guard says of one sample."""

    GOOD = 0
    MISSING = 1
    REFUSED = 2
    JUMPED = 3


def fresh_memory() -> Vector:
    """Memory of a guard that has seen nothing."""
    return np.array([math.nan, math.nan, 0.0, math.nan, math.nan, 0.0, 0.0, 0.0, 0.0])


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

    def judge(self, x: Vector, y: Vector) -> Verdicts:
        """Verdicts (N,) on samples (N,), see :class:`Verdict`; the guard remembers what it needs of them."""
        verdicts = np.empty(x.size, dtype=np.int64)
        bindings.guard_judge(self.memory, x, y, verdicts)
        return verdicts
