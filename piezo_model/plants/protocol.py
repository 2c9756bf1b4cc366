"""What a plant is: y(k) = Γ[x](k), a drive voltage in and a displacement out, one sample after the other.

A plant is the truth that the experiments run against, so it is written apart from the model that is identified
from it. Whatever it remembers (hysteresis, creep, noise) lives in arrays that can be saved and put back; a run is
therefore the same, bit for bit, however it is cut into chunks.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solvers.arrays import Vector

Memory = dict[str, NDArray[Any]]


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

    @abstractmethod
    def state(self) -> Memory:
        """Return a copy of everything that the plant remembers, by name."""

    @abstractmethod
    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Put back what :meth:`state` gave; raises ValueError where it is the state of another plant."""


def replace(memory: Memory, state: Mapping[str, NDArray[Any]], owner: str) -> None:
    """Copy a saved state into arrays of the same names and shapes.

    Raises
    ------
    ValueError
        Where a name or a shape differs; nothing is changed then.
    """
    if set(state) != set(memory):
        raise ValueError(f"the state of {owner} has the arrays {sorted(memory)}, not {sorted(state)}")
    for name, array in memory.items():
        if np.shape(state[name]) != array.shape:
            raise ValueError(f"the state {name!r} of {owner} has the shape {array.shape}, not {np.shape(state[name])}")
    for name, array in memory.items():
        array[...] = state[name]
