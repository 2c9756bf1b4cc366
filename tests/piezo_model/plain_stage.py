"""A stage of three plays."""

import numpy as np
from scipy.signal import lfilter

from piezo_model.operators import play
from solvers.arrays import Vector

THRESHOLDS = np.array([0.24, 0.8, 2.0])


def stage(u: Vector, before: float | Vector = 1.0, creep: float = 0.0, sample_time: float = 0.01) -> Vector:
    """Micrometres for 1 to 9 V, settled at 1 V; ``before`` are the states of the plays before it or a level from which
    they came, ``creep`` is the share of a decade of time."""
    plays = play(u, THRESHOLDS, np.broadcast_to(before, 3).copy())[0]
    crept = [lfilter([0, a], [1, a - 1], u - u[0]) for a in -np.expm1(-sample_time * 10.0 ** np.arange(1, -3, -1))]
    return np.asarray(40 * (0.8 * u + plays @ [0.1, 0.08, 0.06] + creep * np.sum(crept, axis=0)))
