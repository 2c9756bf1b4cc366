"""The protocol of a plant y(k) = Γ[x](k), from a drive voltage to a displacement, sample by sample.

A plant is the ground truth of an experiment, so it is implemented independently of the identified model. A run in
chunks gives the same bits as a single run. A copy of any kind includes the state (hysteresis, creep, noise) and is
independent.
"""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from piezo_model.core import Stateful
from solvers.arrays import Vector


class Plant(Stateful, ABC):
    """An actuator, or an actuator with its sensor, sampled every ``sample_time`` seconds."""

    x_range: tuple[float, float]
    """Range of the amplifier, V; the drive is limited to it."""
    y_range: tuple[float, float]
    """Range of the displacement, µm, without drift and sensor noise."""
    sample_time: float
    """Sampling period, s."""

    @abstractmethod
    def run(self, x: ArrayLike) -> Vector:
        """Continue with a drive.

        Parameters
        ----------
        x : array_like, shape (N,)
            Drive, V.

        Returns
        -------
        ndarray, shape (N,)
            Displacement, µm; sample k depends on x[0..k].

        Raises
        ------
        ValueError
            If the drive is not 1-d or not finite.
        """

    def step(self, x: float) -> float:
        """Continue with one sample: x in V, the displacement in µm, to the last bit as :meth:`run`."""
        return float(self.run(np.array([x], dtype=np.float64))[0])

    @abstractmethod
    def reset(self) -> None:
        """Restore the initial state: at rest at the low end of the range, at time zero."""
