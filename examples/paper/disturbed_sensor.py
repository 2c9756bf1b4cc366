"""A sensor with disturbances that the plants of the package do not have: a swinging gain, a lag, and gaps.

    g(t) = 1 + ĝ sin(2π t / T),   l(k) = l(k−1) + (1 − e^(−Ts/τ)) (d(k) − l(k−1))

d is the displacement with the gain g about the centre of the range, and NaN stands for the last G of every P samples.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import lfilter

from piezo_model import plants
from solvers.arrays import Vector


@dataclass(eq=False)
class LaggingPlant(plants.Plant):
    """A plant whose gain swings, and whose displacement is seen late; the lag is settled at the first sample."""

    plant: plants.Plant
    gain_swing: float
    gain_swing_period_s: float
    lag_s: float

    def __post_init__(self) -> None:
        """Start at time zero."""
        self.x_range, self.y_range, self.sample_time = self.plant.x_range, self.plant.y_range, self.plant.sample_time
        self._keep = math.exp(-self.sample_time / self.lag_s) if self.lag_s > 0.0 else 0.0
        self._begin()

    def _begin(self) -> None:
        self._samples, self._state = 0, np.zeros(1)

    def run(self, x: ArrayLike) -> Vector:
        """Continue with a drive."""
        y, first, centre = self.plant.run(x), self._samples, 0.5 * sum(self.y_range)
        if not y.size:
            return y
        angles = 2.0 * np.pi * self.sample_time / self.gain_swing_period_s * np.arange(first, first + y.size)
        # sine by sine, so that one sample has the same bits as many
        seen = centre + (1.0 + self.gain_swing * np.array([math.sin(angle) for angle in angles])) * (y - centre)
        if not first:
            self._state = self._keep * seen[:1]
        self._samples += y.size
        late, self._state = lfilter([1.0 - self._keep], [1.0, -self._keep], seen, zi=self._state)
        return np.asarray(late)

    def reset(self) -> None:
        """Put the plant at rest."""
        self.plant.reset()
        self._begin()


class DisturbedSensor(plants.Sensor):
    """A sensor of a `LaggingPlant`, with gaps."""

    def __init__(
        self,
        plant: plants.Plant,
        *,
        gain_swing: float = 0.0,
        gain_swing_period_s: float = 10.0,
        lag_s: float = 0.0,
        gap_samples: int = 0,
        gap_period_samples: int = 1000,
        **options: float,
    ) -> None:
        self._gap = gap_samples, gap_period_samples
        super().__init__(LaggingPlant(plant, gain_swing, gain_swing_period_s, lag_s), **options)  # type: ignore[arg-type]

    def run(self, x: ArrayLike) -> Vector:
        """Continue with a drive and measure."""
        first, (length, period) = self._samples, self._gap
        y = super().run(x)
        return np.where((first + np.arange(y.size)) % period < period - length, y, np.nan)
