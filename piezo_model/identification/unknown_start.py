"""The states that the actuator started with, which no recording holds.

A play of threshold r is known once the drive has moved by 2r peak to peak, whatever it started at, so the data basis counts
from there. Creep states forget their start at their own rate; those that are slower than the recording would pull the fit
for all of its length, so the level at which they rested is found as one more unknown.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import minimize_scalar

from piezo_model.identification.fitting import accumulate, error_percent, optimum
from piezo_model.operator_state import OperatorArrays, OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure


def settled_from(recording: Recording, s: ModelStructure) -> int:
    """Index of the first sample at which every play that the drive moves at all is known, whatever it started at."""
    span = recording.x_range[1] - recording.x_range[0]
    needed = max((2.0 * r * s.x_scale for r in s.play_thresholds if 2.0 * r * s.x_scale < span), default=0.0)
    low, high, seen = math.inf, -math.inf, 0
    for x, _ in recording.chunks():
        lows, highs = np.minimum.accumulate(np.minimum(x, low)), np.maximum.accumulate(np.maximum(x, high))
        known = np.flatnonzero(highs - lows >= needed)
        if known.size:
            return seen + int(known[0])
        low, high, seen = lows[-1], highs[-1], seen + x.size
    return seen


def counted_y_range(recording: Recording, skip: int) -> tuple[float, float]:
    """Range of the output after the first ``skip`` samples."""
    low, high, seen = math.inf, -math.inf, 0
    for _, y in recording.chunks():
        counted = y[max(skip - seen, 0):]
        low, high = float(np.min(counted, initial=low)), float(np.max(counted, initial=high))
        seen += y.size
    return low, high


def unknown_start(recording: Recording, s: ModelStructure, level: float) -> OperatorState:
    """Return the states of an actuator that rested at ``level``; plays that the drive is too small for never move."""
    state, low, high = OperatorState.at_rest(s, level), *s.unit_input(np.array(recording.x_range))
    state.play[2.0 * OperatorArrays.of(s).r >= high - low] = 0.5 * (low + high)
    return state


def resting_level(recording: Recording, s: ModelStructure, skip: int, solver: str, proximal: float) -> float:
    """Input in unit amplitudes at which the creep states started: the one unknown of a start that nobody recorded.

    Fast states forget it at once; states that are slower than the recording would pull the fit for all of its length.
    """
    if not s.creep_rates:
        return 0.0

    def error(level: float) -> float:
        problem = accumulate(recording, s, skip, unknown_start(recording, s, level), proximal)
        return error_percent(problem, optimum(problem, solver))

    grid = np.linspace(-1.0, 1.0, 9)
    best = grid[int(np.argmin([error(level) for level in grid]))]
    found = minimize_scalar(error, bounds=(max(best - 0.25, -1.0), min(best + 0.25, 1.0)), method="bounded",
                            options={"xatol": 1e-3})
    return float(found.x)
