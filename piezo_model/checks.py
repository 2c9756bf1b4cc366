"""Checks of arguments that many functions share; each refuses with a ValueError that names the argument."""

import math

import numpy as np
from numpy.typing import ArrayLike

from solvers.arrays import Vector


def positive(**arguments: float) -> None:
    """Refuse what is not a positive number."""
    for name, value in arguments.items():
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} must be a positive number, not {value}")


def not_negative(**arguments: float) -> None:
    """Refuse what is not a finite number of at least 0."""
    for name, value in arguments.items():
        if not 0.0 <= value < math.inf:
            raise ValueError(f"{name} must be a finite number of at least 0, not {value}")


def finite(**arguments: float) -> None:
    """Refuse what is not a finite number."""
    for name, value in arguments.items():
        if not math.isfinite(value):
            raise ValueError(f"{name} must be a finite number, not {value}")


def whole(least: int, **arguments: int) -> None:
    """Refuse what is not a whole number of at least ``least``."""
    for name, value in arguments.items():
        if not (isinstance(value, int | np.integer) and value >= least):
            raise ValueError(f"{name} must be a whole number of at least {least}, not {value}")


def between(low: float, high: float, **arguments: float) -> None:
    """Refuse what is not strictly between two numbers."""
    for name, value in arguments.items():
        if not low < value < high:
            raise ValueError(f"{name} must be above {low:g} and below {high:g}, not {value}")


def ascending(**arguments: tuple[float, float]) -> None:
    """Refuse what is not two finite numbers in ascending order."""
    for name, (low, high) in arguments.items():
        if not -math.inf < low < high < math.inf:
            raise ValueError(f"{name} must be two finite numbers in ascending order, not ({low}, {high})")


def vectors(**arguments: ArrayLike) -> list[Vector]:
    """The arguments as arrays (N,) of doubles; refuse what are not vectors of the same length."""
    arrays = [np.ascontiguousarray(values, dtype=np.float64) for values in arguments.values()]
    if arrays[0].ndim != 1 or len({array.shape for array in arrays}) > 1:
        shapes = " and ".join(str(array.shape) for array in arrays)
        raise ValueError(f"{' and '.join(arguments)} must be vectors of the same length, not of shapes {shapes}")
    return arrays


def finite_arrays(**arguments: Vector) -> None:
    """Refuse an array with a number that is not finite, by the first."""
    for name, values in arguments.items():
        if not np.all(np.isfinite(values)):
            raise ValueError(f"{name}[{int(np.argmin(np.isfinite(values)))}] is not a finite number")
