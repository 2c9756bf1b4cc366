"""Data-sheet figures of an actuator, from its model: gain, hysteresis, creep and offset.

Gain and hysteresis are those of the loop over the whole range of the input: the output's range divided by the input's,
and the largest width of the loop divided by the output's range. The gain includes creep in the first tenth of a second
after a step, from which data sheets count creep, since no recording determines creep at shorter times. Creep is the
movement from t to 10 t after a step to 80 % of the range, relative to the movement until t, where t and 10 t lie in the
middle of the model's creep rates. The offset is the constant of the model, referred to its input.

Source: H. Jung and D.-G. Gweon, "Creep characteristics of piezoelectric actuators", Review of Scientific Instruments 71
(2000) 1896–1900, for the tenth of a second.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

import piezo_model
from piezo_model.operator_state import OperatorState
from solvers.arrays import Vector

POINTS = 200
"""Samples of each branch of the loop, and of the step until t."""
STEP, CREEPS_FROM_S = 0.8, 0.1
"""Step relative to the range; time after the step from which creep counts."""


def figures_of(model: piezo_model.HysteresisCreepModel) -> dict[str, float]:
    """Gain in output unit per input unit, hysteresis and creep in %, offset in the input unit, by name."""
    s = model.structure
    low, high = s.x_range
    up = np.linspace(low, high, POINTS)
    bare = replace(model, structure=replace(s, creep_rates=()), w_K=np.zeros(0), start=None, report={}, dynamics=None)
    settled = OperatorState.settled_at(bare.structure, low, came_from="above")
    rising, falling = np.split(bare.simulate(np.concatenate([up, up[::-1]]), settled), 2)
    span, grown, creep = rising[-1] - rising[0], 1.0, 0.0
    if np.any(model.w_K > 0.0):
        grown = _movement(model, CREEPS_FROM_S, POINTS)[-1]
        later = _movement(model, 1.0 / math.sqrt(10.0 * max(s.creep_rates) * min(s.creep_rates)), 10 * POINTS)
        creep = 100.0 * float(later[-1] / later[POINTS] - 1.0)
    return {
        "gain": float(grown * span / (high - low)),
        "hysteresis_percent": 100.0 * float(np.max(np.abs(falling[::-1] - rising)) / abs(span)),
        "creep_percent_per_decade": creep,
        "offset": model.offset * s.x_scale,
    }


def _movement(model: piezo_model.HysteresisCreepModel, t: float, samples: int) -> Vector:
    """Movement (N,) after a step, with the time t at sample POINTS, relative to the immediate movement."""
    s, (low, high) = model.structure, model.structure.x_range
    slow = replace(model.static.at(t / POINTS), start=None)
    x = np.full(samples + 2, low + STEP * (high - low))
    x[0] = low
    y = slow.simulate(x, OperatorState.settled_at(slow.structure, low, came_from="above")) - s.y_centre
    return np.asarray((y[1:] - y[0]) / (y[1] - y[0]))
