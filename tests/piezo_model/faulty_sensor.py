"""A sensor with every kind of fault, and invalid references."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from piezo_model import plants
from piezo_model.signals import staircase

Vector = NDArray[np.float64]

SENSOR_FAULTS = ("nan", "infinite", "frozen", "drop-out", "rail", "offset", "garbage", "spikes", "clipped", "noisy")
REFERENCE_FAULTS = ("nan", "infinite", "huge", "far", "jumps")


class FaultySensor:
    """An actuator's sensor; while ``failing`` is true, it has faults of random kinds and durations."""

    def __init__(
        self, plant: plants.Plant, seed: int, kinds: tuple[str, ...] = SENSOR_FAULTS, mean_length: int = 400
    ) -> None:
        self.plant, self.kinds, self.failing, self._mean = plant, kinds, True, mean_length
        self.low, self.high = plant.y_range
        self._random = np.random.default_rng(seed)
        self._kind, self._left, self._last, self._offset = "good", 0, 0.0, 0.0

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
                self._offset = self._random.uniform(-1.0, 1.0) * (self.high - self.low)
            part = slice(done, min(done + self._left, y.size))
            y[part] = self._spoil(y[part])
            self._left -= part.stop - part.start
            done = part.stop
            if np.isfinite(y[done - 1]):
                self._last = float(y[done - 1])
        return y

    def _spoil(self, y: Vector) -> Vector:
        span, random = self.high - self.low, self._random
        match self._kind:
            case "nan":
                return np.full_like(y, np.nan)
            case "infinite":
                return random.choice([np.inf, -np.inf], y.size)
            case "frozen":
                return np.full_like(y, self._last)
            case "drop-out":
                return np.full_like(y, 0.5 * (self.low + self.high))
            case "rail":
                return np.full_like(y, self.high + 0.2 * span)
            case "offset":
                return y + self._offset
            case "garbage":
                return random.uniform(self.low - span, self.high + span, y.size)
            case "spikes":
                return np.where(random.random(y.size) < 0.02, y + random.normal(0.0, span, y.size), y)
            case "clipped":
                return np.clip(y, self.low + 0.3 * span, self.high - 0.3 * span)
            case "noisy":
                return y + random.normal(0.0, 0.02 * span, y.size)
        return y


def spoiled(y_ref: Vector, low: float, high: float, seed: int, mean_length: int = 300) -> Vector:
    """The reference with about a third of its samples NaN, infinite, huge, out of range or jumping."""
    random, out, at = np.random.default_rng(seed), y_ref.copy(), 0
    while at < out.size:
        at += int(random.exponential(2 * mean_length))
        part = out[at : at + 1 + int(random.exponential(mean_length))]
        match random.choice(REFERENCE_FAULTS):
            case "nan":
                part[:] = np.nan
            case "infinite":
                part[:] = random.choice([np.inf, -np.inf], part.size)
            case "huge":
                part[:] = random.choice([1e300, -1e300, 1.7e308, 1e12], part.size)
            case "far":
                part[:] = random.uniform(2 * low - high, 2 * high - low)
            case "jumps":
                part[:] = random.uniform(low, high, part.size)
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


Actuator = Callable[[Vector], Vector]
