"""Checks of arguments that many functions share; each raises a ValueError that names the argument."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from decimal import Decimal
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from piezo_model.json_file import LARGEST, brief
from solvers.arrays import Matrix, reals


def require(valid: Callable[[Any], Any], what: str, /, **arguments: Any) -> None:
    """Require a condition of each argument; ``what`` states it in words. True and False never meet it, nor does a
    Decimal, which has no product with a float.

    Examples
    --------
    >>> require(lambda t: t > 0.0, "a positive number", time_s=Decimal("1.5"))
    Traceback (most recent call last):
    ValueError: time_s must be a positive number, not 1.5
    """
    for name, value in arguments.items():
        plain = value.item() if isinstance(value, np.generic) else value  # LARGEST overflows single precision
        try:
            fits = not isinstance(plain, bool | Decimal) and bool(valid(plain))
        except (TypeError, ValueError, LookupError, OverflowError):  # of another type, or an integer beyond doubles
            fits = False
        if not fits:
            raise ValueError(f"{name} must be {what}, not {repr(value) if isinstance(value, str) else value}")


@contextmanager
def refusing(error: type[Exception], label: str = "") -> Iterator[None]:
    """Raise a ValueError of the block as another class, with a label before the message."""
    try:
        yield
    except ValueError as refused:
        raise error(f"{label}{brief(refused)}") from None


def check(condition: Any, otherwise: str, error: type[Exception] = ValueError) -> None:
    """Raise an error with the sentence unless the condition holds."""
    if not condition:
        raise error(otherwise)


def instance(kind: type[Any], **arguments: Any) -> None:
    """Require objects of a class."""
    require(lambda value: isinstance(value, kind), f"a {kind.__name__}", **arguments)


def positive(**arguments: float) -> None:
    """Require positive numbers."""
    require(lambda value: math.isfinite(value) and value > 0.0, "a positive number", **arguments)


def not_negative(**arguments: float) -> None:
    """Require finite numbers of at least 0."""
    require(lambda value: math.isfinite(value) and value >= 0.0, "a finite number of at least 0", **arguments)


def finite(**arguments: float) -> None:
    """Require finite numbers."""
    require(math.isfinite, "a finite number", **arguments)


def whole(least: int, **arguments: int) -> None:
    """Require integers of at least ``least``."""
    require(
        lambda value: isinstance(value, int) and value >= least,
        f"a whole number of at least {least}",
        **arguments,
    )


def between(low: float, high: float, **arguments: float) -> None:
    """Require numbers strictly between two limits."""
    require(lambda value: low < value < high, f"above {low:g} and below {high:g}", **arguments)


def one_of(choices: Sequence[str], **arguments: str) -> None:
    """Require one of several words."""
    require(lambda value: value in choices, f"one of {', '.join(choices)}", **arguments)


def flags(count: int, **arguments: ArrayLike) -> None:
    """Require True or False, or arrays (count,) of them; none for the count 0."""
    require(
        lambda value: value.dtype == np.bool_ and value.shape in ((), (count,)),
        f"True or False{(count and f', or an array of {count} of them') or ''}",
        **{name: np.array(value) for name, value in arguments.items()},
    )


def share(**arguments: float) -> None:
    """Require numbers from 0 to below 1."""
    require(lambda value: 0.0 <= value < 1.0, "at least 0 and below 1", **arguments)


def ascending(**arguments: tuple[float, float]) -> None:
    """Require pairs of finite numbers, of at most `LARGEST` in size, in ascending order."""
    require(
        lambda pair: len(pair) == 2 and -LARGEST <= (ends := reals("", pair))[0] < ends[1] <= LARGEST,
        "two finite numbers in ascending order",
        **arguments,
    )


def vectors(count: int | None = None, /, **arguments: ArrayLike) -> list[Matrix]:
    """The arguments as arrays (N,), or (N, count), of doubles; require real numbers, and the same shape."""
    arrays = [reals(name, values) for name, values in arguments.items()]
    shapes, row = [array.shape for array in arrays], () if count is None else (count,)
    if not shapes[0] or shapes[0][1:] != row or len(set(shapes)) > 1:
        one_vector = "a vector, such as [1.0, 2.0] or one column"
        what = f"of shape (N, {count})" if row else "vectors of the same length" if shapes[1:] else one_vector
        raise ValueError(
            f"{' and '.join(arguments)} must be {what}, not of shape{'s' * (len(shapes) > 1)} "
            f"{' and '.join(map(str, shapes))}"
        )
    return arrays


def finite_arrays(**arguments: Matrix) -> None:
    """Require arrays of finite numbers, of at most `LARGEST` in size."""
    for name, values in arguments.items():
        if not np.all(finite := np.abs(values) <= LARGEST):
            raise ValueError(f"{name}{np.argwhere(~finite)[0].tolist()} is not a finite number")
