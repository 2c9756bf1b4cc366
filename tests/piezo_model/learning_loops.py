"""Self-learning compensators of simulated actuators at 1 kHz, small enough for tests; a sensor with every kind of
fault, and invalid references."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from piezo_model import HysteresisCreepModel, ModelStructure, OperatorState, SelfLearningCompensator, plants
from piezo_model.signals import staircase
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


def stretched(factor: float) -> ModelStructure:
    """The structure of an actuator whose ranges were given too wide by a factor."""
    true = structure_for(sensor())
    return replace(true, x_scale=factor * true.x_scale, y_scale=factor * true.y_scale)


PLANT = plants.get("relay_preisach", sample_time=T)
STRUCTURE = structure_for(PLANT)
MODEL = HysteresisCreepModel.from_weights(STRUCTURE, STRUCTURE.straight_line)
"""The straight line of an actuator."""


def learner_for(
    plant: plants.Plant,
    mode: str = "cyclic",
    solver: str = "box_active_set",
    offset: bool = True,
    n: int = 5,
    m: int = 3,
    **options: Any,
) -> SelfLearningCompensator:
    """A learner of an actuator at the low end of its drive."""
    structure = structure_for(plant, offset, n, m)
    chosen = {"reset_s": 0.1, "build_s": 4.0, "learn_s": 0.5, "hand_over_s": 0.02, "solve_delay_samples": 5, **options}
    start = OperatorState.settled_at(structure, structure.x_range[0], came_from="above")
    return SelfLearningCompensator(structure, solver=solver, mode=mode, state=start, **chosen)


def at_work(
    seconds: float, *of_learner: str, plant: str = "dense_prandtl_ishlinskii", **options: Any
) -> tuple[plants.Sensor, SelfLearningCompensator, Vector]:
    """An actuator, its learner, and a reference for it."""
    one = sensor(plant)
    return one, learner_for(one, *of_learner, **options), steps(one, seconds)


SENSOR_FAULTS: dict[str, Callable[[Any, Vector, np.random.Generator, float], Vector]] = {
    "nan": lambda sensor, y, random, span: np.full_like(y, np.nan),
    "infinite": lambda sensor, y, random, span: random.choice([np.inf, -np.inf], y.size),
    "frozen": lambda sensor, y, random, span: np.full_like(y, sensor.last),
    "drop-out": lambda sensor, y, random, span: np.full_like(y, 0.5 * (sensor.low + sensor.high)),
    "rail": lambda sensor, y, random, span: np.full_like(y, sensor.high + 0.2 * span),
    "offset": lambda sensor, y, random, span: y + sensor.offset,
    "garbage": lambda sensor, y, random, span: random.uniform(sensor.low - span, sensor.high + span, y.size),
    "spikes": lambda sensor, y, random, span: np.where(
        random.random(y.size) < 0.02, y + random.normal(0.0, span, y.size), y
    ),
    "clipped": lambda sensor, y, random, span: np.clip(y, sensor.low + 0.3 * span, sensor.high - 0.3 * span),
    "noisy": lambda sensor, y, random, span: y + random.normal(0.0, 0.02 * span, y.size),
    "good": lambda sensor, y, random, span: y,
}
"""The output of a sensor with each fault, for a part of the right one."""
REFERENCE_FAULTS: dict[str, Callable[[np.random.Generator, int, float, float], float | Vector]] = {
    "nan": lambda random, size, low, high: np.nan,
    "infinite": lambda random, size, low, high: random.choice([np.inf, -np.inf], size),
    "huge": lambda random, size, low, high: random.choice([1e300, -1e300, 1.7e308, 1e12], size),
    "far": lambda random, size, low, high: random.uniform(2 * low - high, 2 * high - low),
    "jumps": lambda random, size, low, high: random.uniform(low, high, size),
}


class FaultySensor:
    """An actuator's sensor; while ``failing`` is true, it has faults of random kinds and durations."""

    def __init__(
        self, plant: plants.Plant, seed: int, kinds: tuple[str, ...] = tuple(SENSOR_FAULTS)[:-1], mean_length: int = 400
    ) -> None:
        self.plant, self.kinds, self.failing, self._mean = plant, kinds, True, mean_length
        self.low, self.high = plant.y_range
        self._random = np.random.default_rng(seed)
        self._kind, self._left, self.last, self.offset = "good", 0, 0.0, 0.0

    def __call__(self, x: Vector) -> Vector:
        y = self.plant.run(x)
        done = 0
        while done < y.size:
            if not self.failing:
                self._kind, self._left = "good", y.size
            elif self._left == 0:
                good = self._kind != "good" and self._random.random() < 0.5
                self._kind = "good" if good else str(self._random.choice(self.kinds))
                self._left = 1 + int(self._random.exponential(self._mean))
                self.offset = self._random.uniform(-1.0, 1.0) * (self.high - self.low)
            part = slice(done, min(done + self._left, y.size))
            y[part] = SENSOR_FAULTS[self._kind](self, y[part], self._random, self.high - self.low)
            self._left -= part.stop - part.start
            done = part.stop
            if np.isfinite(y[done - 1]):
                self.last = float(y[done - 1])
        return y


def spoiled(y_ref: Vector, low: float, high: float, seed: int, mean_length: int = 300) -> Vector:
    """The reference with about a third of its samples NaN, infinite, huge, out of range or jumping."""
    random, out, at = np.random.default_rng(seed), y_ref.copy(), 0
    while at < out.size:
        at += int(random.exponential(2 * mean_length))
        part = out[at : at + 1 + int(random.exponential(mean_length))]
        part[:] = REFERENCE_FAULTS[random.choice(tuple(REFERENCE_FAULTS))](random, part.size, low, high)
        at += part.size
    return out


def steps(plant: plants.Plant, seconds: float, hold_s: float = 0.1) -> Vector:
    """The staircase of the paper's Fig. 4 over most of the plant's range."""
    low, high = plant.y_range
    margin = 0.1 * (high - low)
    return staircase(
        duration_s=seconds, sample_time=plant.sample_time, low=low + margin, high=high - margin, levels=9, hold_s=hold_s
    )


def rms_percent(y: Vector, y_ref: Vector, plant: plants.Plant) -> float:
    """RMS error in percent of the plant's range."""
    return float(100.0 * np.sqrt(np.mean((y - y_ref) ** 2)) / (plant.y_range[1] - plant.y_range[0]))
