"""Checks of arguments that many functions share; each raises a ValueError that names the argument."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from solvers.arrays import Vector


def _require(arguments: Mapping[str, Any], valid: Callable[[Any], Any], what: str) -> None:
    for name, value in arguments.items():
        if not valid(value):
            raise ValueError(f"{name} must be {what}, not {value}")


def positive(**arguments: float) -> None:
    """Require positive numbers."""
    _require(arguments, lambda value: 0.0 < value < math.inf, "a positive number")


def not_negative(**arguments: float) -> None:
    """Require finite numbers of at least 0."""
    _require(arguments, lambda value: 0.0 <= value < math.inf, "a finite number of at least 0")


def finite(**arguments: float) -> None:
    """Require finite numbers."""
    _require(arguments, math.isfinite, "a finite number")


def whole(least: int, **arguments: int) -> None:
    """Require integers of at least ``least``."""
    _require(
        arguments,
        lambda value: isinstance(value, int | np.integer) and value >= least,
        f"a whole number of at least {least}",
    )


def between(low: float, high: float, **arguments: float) -> None:
    """Require numbers strictly between two limits."""
    _require(arguments, lambda value: low < value < high, f"above {low:g} and below {high:g}")


def ascending(**arguments: tuple[float, float]) -> None:
    """Require pairs of finite numbers in ascending order."""
    _require(arguments, lambda pair: -math.inf < pair[0] < pair[1] < math.inf, "two finite numbers in ascending order")


def vectors(**arguments: ArrayLike) -> list[Vector]:
    """The arguments as arrays (N,) of doubles; require vectors of the same length."""
    arrays = [np.ascontiguousarray(values, dtype=np.float64) for values in arguments.values()]
    if arrays[0].ndim != 1 or len({array.shape for array in arrays}) > 1:
        shapes = " and ".join(str(array.shape) for array in arrays)
        raise ValueError(f"{' and '.join(arguments)} must be vectors of the same length, not of shapes {shapes}")
    return arrays


def finite_arrays(**arguments: Vector) -> None:
    """Require arrays of finite numbers."""
    for name, values in arguments.items():
        if not np.all(np.isfinite(values)):
            raise ValueError(f"{name}[{int(np.argmin(np.isfinite(values)))}] is not a finite number")
