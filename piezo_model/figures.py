"""Data-sheet figures of an actuator, from its model: gain, hysteresis, creep and offset.

Gain and hysteresis are those of the loop over the whole range of the input, without creep: the output's range by the
input's, and the largest width of the loop by the output's range. Creep is what a step to 80 % of the range adds from t
to 10 t after it, as a share of the movement until t, where t and 10 t lie in the middle of the model's creep rates. The
offset is the constant of the model, referred to its input.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

import piezo_model
from piezo_model.operator_state import OperatorState

POINTS = 200
"""Samples of each branch of the loop, and of the step until t."""
STEP = 0.8
NAMES = ("gain", "hysteresis_percent", "creep_percent_per_decade", "offset")


def figures_of(model: piezo_model.HysteresisCreepModel) -> dict[str, float]:
    """Gain in output unit per input unit, hysteresis and creep in %, offset in the input unit, by name."""
    s = model.structure
    low, high = s.x_range
    up = np.linspace(low, high, POINTS)
    bare = replace(model, structure=replace(s, creep_rates=()), w_K=np.zeros(0), start=None, report={}, dynamics=None)
    settled = OperatorState.settled_at(bare.structure, low, came_from="above")
    rising, falling = np.split(bare.simulate(np.concatenate([up, up[::-1]]), settled), 2)
    span = rising[-1] - rising[0]
    return {
        "gain": float(span / (high - low)),
        "hysteresis_percent": 100.0 * float(np.max(np.abs(falling[::-1] - rising)) / abs(span)),
        "creep_percent_per_decade": _creep_percent(model) if np.any(model.w_K > 0.0) else 0.0,
        "offset": model.offset * s.x_scale,
    }


def _creep_percent(model: piezo_model.HysteresisCreepModel) -> float:
    s, (low, high) = model.structure, model.structure.x_range
    early = 1.0 / math.sqrt(10.0 * max(s.creep_rates) * min(s.creep_rates))
    slow = replace(model.static.at(early / POINTS), start=None)
    x = np.full(10 * POINTS + 1, low + STEP * (high - low))
    x[0] = low
    y = slow.simulate(x, OperatorState.settled_at(slow.structure, low, came_from="above"))
    return 100.0 * float((y[10 * POINTS] - y[POINTS]) / (y[POINTS] - y[0]))
