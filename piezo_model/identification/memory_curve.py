"""The memory curve: play states z over their thresholds r start at the input, z(0) = x, with |dz/dr| ≤ 1, and keep what
the past has left.

Source: M. Brokate and J. Sprekels, Hysteresis and Phase Transitions, 1996, section 2.3.
"""

import numpy as np

from piezo_model.operator_state import OperatorState, padded_thresholds
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector


def initial_slopes(s: ModelStructure, state: OperatorState) -> Vector:
    """Slopes dz/dr of the play states over the thresholds, shape (n,), from −1 to 1."""
    return np.asarray(np.clip(np.diff(state.play[: s.n + 1]) / np.diff(s.thresholds), -1.0, 1.0))


def state_with_slopes(part: Recording, s: ModelStructure, slopes: Vector | float) -> OperatorState:
    """States of a memory curve with slopes dz/dr that begins at the first input of a part; creep rests with the plays.

    A play too wide for the drive rests in the middle, where the drive does not move it.
    """
    low, high = s.unit_input(np.array([part.x.min(), part.x.max()]))
    first, half = float(s.unit_input(part.x[:1])[0]), 0.5 * (high - low)
    r, play = padded_thresholds(s), np.full(s.lanes, first)
    play[1 : s.n + 1] += np.cumsum(np.diff(s.thresholds) * slopes)
    play = np.where(r >= half, 0.5 * (low + high), play)
    return OperatorState(play, np.tile(play, len(s.creep_rates)))
