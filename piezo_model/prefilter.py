"""The dynamics of a stage as the core's prefilter takes them (``core/prefilter.h``): constants and states.

The learner also inverts the modes of the measured output: F y is the output of a static actuator, delayed by the group
delay of F G at frequency 0. The drive is delayed by the next larger number of whole samples, and F y by the difference,
by linear interpolation. Faster poles than those of F would follow fast scans slightly better, but amplify noise and the
rest of the resonance if its frequency is wrong.
"""

import math

import numpy as np

from piezo_model.dynamics import Dynamics
from piezo_model.structure import ModelStructure
from solvers.arrays import Matrix, Vector

FORGOTTEN = 1e-4
"""Fraction of the largest value of the response of F below which the response has ended."""
THIRD_DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0])
MODE = 9
"""Numbers of a mode."""
TAPS = 8
"""Room for the zeros of the stage, plus one."""
STATES = 8 + TAPS
"""Numbers of the states after the constants, before the ring of references and that of drives (one more)."""


class Prefilter:
    """Constants of the core for dynamics at a sampling period; empty without dynamics."""

    def __init__(self, dynamics: Dynamics | None, sample_time: float) -> None:
        self.modes = self.ring = 0
        self.constants, self.noise_gains = np.zeros(0), np.zeros(2)
        if dynamics is None:
            return
        self.modes = len(dynamics.frequencies_Hz)
        pairs = dynamics.pole_pairs(sample_time)
        lag = max(0.0, dynamics.delay_behind_inverse(sample_time))
        late, (whole, taps) = math.ceil(lag), dynamics.zeros(sample_time)
        longest = max((-30.0 / math.log(R[2] / R[0]) for _, R in pairs), default=0.0)
        pulse = np.zeros(math.ceil(longest) + MODE)
        pulse[:2] = 1.0 - (late - lag), late - lag
        h = dynamics.inverse(pulse, sample_time, 0.0)  # the impulse response of the interpolation and F
        self.ring = 1 + max(late, whole)
        decay = math.exp(-sample_time / dynamics.amplifier_lag_s) if dynamics.amplifier_lag_s else 0.0
        forgotten = 1 + int(np.flatnonzero(np.abs(h) > FORGOTTEN * np.max(np.abs(h)))[-1])
        modes = [[1 / R[0], 1 - R[2] / R[0], 1 / D[0], D[0] - D[2], R[0], D[0], 0, 0, 0] for D, R in 3 * pairs]
        self.constants = np.concatenate(
            [*modes, [decay, whole, late, late - lag, forgotten], taps, np.zeros(TAPS - taps.size)]
        )
        """In the layout of the core, where the states follow."""
        self.noise_gains = np.array([h @ h, 1.0 / np.sum(np.convolve(h, THIRD_DIFFERENCE) ** 2)])
        """Factor by which F changes the variance of white noise, and the inverse of that for third differences."""

    def with_states(self, values: Matrix) -> Matrix:
        """The constants of this model with the states of saved prefilters (…, ·)."""
        whole, at = values.copy(), np.arange(self.constants.size)
        at = at[(at >= 3 * self.modes * MODE) | (at % MODE < MODE - 3)]
        whole[..., at] = self.constants[at]
        return whole

    def rescaled(self, values: Vector, old: ModelStructure, new: ModelStructure) -> Vector:
        """Constants and states for other ranges, in whose normalised units the drives differ."""
        values = values.copy()
        drives = values[self.constants.size + STATES + self.ring :][: self.ring + 1]
        drives[:] = new.unit_input(old.x_centre + old.x_scale * drives)
        return values
