"""Self-learning compensators of simulated actuators at 1 kHz, small enough for tests."""

from collections.abc import Callable
from typing import Any

from faulty_sensor import rms_percent

from piezo_model import ModelStructure, OperatorState, SelfLearningCompensator, plants
from solvers.arrays import Vector

T = 1e-3
NOISE = 2e-4
"""Standard deviation of the sensor's noise, as a share of the range."""
MODES = ("cyclic", "continuous")
WAYS = (("cyclic", "box_active_set"), ("cyclic", "projected_difference"), ("continuous", "box_active_set"))


def error_of(
    learner: SelfLearningCompensator, y_ref: Vector, actuator: Callable[[Vector], Vector], plant: Any, part: slice
) -> float:
    """RMS error over a part of a run, in per cent of the plant's range."""
    return rms_percent(learner.run(y_ref, actuator)[1][part], y_ref[part], plant)


def sensor(plant: str = "dense_prandtl_ishlinskii", **options: Any) -> plants.Sensor:
    actuator = plants.get(plant, sample_time=T)
    return plants.Sensor(
        actuator, **{"noise_um": NOISE * (actuator.y_range[1] - actuator.y_range[0]), "seed": 1, **options}
    )


def structure_for(plant: plants.Plant, offset: bool = True, n: int = 5, m: int = 3) -> ModelStructure:
    return ModelStructure.equidistant(n, m, plant.x_range, plant.y_range, (100.0, 10.0, 1.0, 0.1), T, offset=offset)


def learner_for(
    plant: plants.Plant, mode: str = "cyclic", solver: str = "box_active_set", offset: bool = True, **options: Any
) -> SelfLearningCompensator:
    """A learner of an actuator at the low end of its drive."""
    structure = structure_for(plant, offset)
    chosen = {"reset_s": 0.1, "build_s": 4.0, "learn_s": 0.5, "hand_over_s": 0.02, "solve_delay_samples": 5, **options}
    start = OperatorState.settled_at(structure, structure.x_range[0], came_from="above")
    return SelfLearningCompensator(structure, solver=solver, mode=mode, state=start, **chosen)
