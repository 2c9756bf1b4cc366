"""What a plant is: y(k) = Γ[x](k), a drive voltage in and a displacement out, one sample after the other.

A plant is the truth that the experiments run against, so it is written apart from the model that is identified
from it. A run is the same, bit for bit, however it is cut into chunks. Whatever a plant remembers (hysteresis, creep,
noise) goes with it into a copy (``copy.deepcopy``), which goes on by itself.
"""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from solvers.arrays import Vector


class Plant(ABC):
    """An actuator, or an actuator with its sensor, sampled every ``sample_time`` seconds."""

    x_range: tuple[float, float]
    """Drive that the amplifier can give, V; what is asked beyond is limited to it."""
    y_range: tuple[float, float]
    """Displacement that the actuator can reach, µm, before any drift or noise of the sensor."""
    sample_time: float
    """Sampling period, s."""

    @abstractmethod
    def run(self, x: ArrayLike) -> Vector:
        """Drive the plant on from where it stands.

        Parameters
        ----------
        x : array_like, shape (N,)
            Drive, V.

        Returns
        -------
        ndarray, shape (N,)
            Displacement, µm; sample k is the answer to x[0..k].

        Raises
        ------
        ValueError
            Where the drive is not 1-d or not finite.
        """

    def step(self, x: float) -> float:
        """Drive the plant one sample on: x in V, the answer in µm, the same bits as :meth:`run` gives."""
        return float(self.run(np.array([x], dtype=np.float64))[0])

    @abstractmethod
    def reset(self) -> None:
        """Put the plant at rest at the low end of its range, time zero, as it was made."""
