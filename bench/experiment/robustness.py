"""Learning in situations drawn at random: how near each mode comes to the floor, and where it does worst.

Each situation (`piezo_model.family`) is an actuator, its sensor and a reference that no rule was made for. The error of
the last of five cycles is divided by the floor (`hindsight`), the best that the same structure can do on that very cycle.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.experiment.hindsight import floor, tracking_error
from piezo_model import Compensator, HysteresisCreepModel, OperatorState, SelfLearningCompensator
from piezo_model.family import CYCLE_S, Situation
from piezo_model.learning.settings import Mode

Vector = NDArray[np.float64]

SAMPLE_TIME = 5e-4
CYCLES = 5
WAYS: dict[str, tuple[Mode, str]] = {"cyclic, projected": ("cyclic", "projected_difference"),
                                     "cyclic, exact": ("cyclic", "box_active_set"),
                                     "continuous": ("continuous", "recursive_active_set")}
"""Mode and solver."""


def learner_of(situation: Situation, way: str, n: int = 5, m: int = 3) -> SelfLearningCompensator:
    """A learner that knows no more than the user does; the actuator is at the low end of its drive."""
    mode, solver = WAYS[way]
    structure = situation.structure(n, m)
    state = OperatorState.at_rest(structure, float(structure.unit_input(np.array(situation.x_limits[0]))), 1.0)
    return SelfLearningCompensator(structure, solver="box_active_set" if mode == "continuous" else solver,
                                   mode=mode, x_limits=situation.x_limits, state=state, samples_to_solve=1)


def straight_error(situation: Situation) -> float:
    """Error in the last cycle of the straight line that a learner starts with."""
    structure, sensor = situation.structure(), situation.sensor()
    model = HysteresisCreepModel.from_weights(structure, structure.straight_line)
    y = sensor.run(Compensator(model, situation.x_limits).run(situation.y_ref))
    last = slice(-round(CYCLE_S / situation.sample_time), None)
    return tracking_error(y[last], situation.y_ref[last])


def rows(seed: int, ways: tuple[str, ...] = tuple(WAYS), reference: str | None = None) -> list[dict[str, Any]]:
    """One row for each way: errors of each cycle, of the straight line and the floor of the last cycle, in the output's unit."""
    situation = Situation.draw(seed, CYCLES * CYCLE_S, SAMPLE_TIME, reference)
    straight = straight_error(situation)
    found = []
    for way in ways:
        sensor, learner, errors = situation.sensor(), learner_of(situation, way), []
        for y_ref in np.split(situation.y_ref, CYCLES):
            state, before, structure = learner.compensator.state.copy(), sensor.state(), learner.structure
            x, y = learner.run(y_ref, sensor.run)
            errors.append(tracking_error(y, y_ref))
            if not (x.min() >= situation.x_limits[0] and x.max() <= situation.x_limits[1]):
                raise AssertionError(f"seed {seed}, {way}: the drive left its limits")
        model = HysteresisCreepModel.from_weights(structure, structure.straight_line)
        least = floor(model, state, sensor, before, x, y, y_ref)
        found.append({"seed": seed, "plant": situation.plant, "reference": situation.reference, "way": way, "ratio": errors[-1] / least,
                      "floor": least, "straight": straight, "hand_overs": learner.counts["hand_overs"],
                      **{f"cycle_{i}": error for i, error in enumerate(errors, 1)}})
    return found
