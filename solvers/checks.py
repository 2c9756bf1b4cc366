"""The check of a program's data and of starting points, the same for all solvers, before any of them sees the numbers.

Shapes fit q; P, q, G, A, b and starts are finite; P is symmetric to 1e-9 of its largest entry; bounds and h are not
NaN, no lower one is +inf, no upper one or h is -inf, and none cross. P and q are checked by compiled code, since an
``update`` is timed: by ``solvers/kernel/bindings_library.c``, or by our own solvers while they copy.
"""

import numpy as np
from numpy.typing import ArrayLike

from solvers.arrays import Matrix, Vector, shaped
from solvers.core import CAPPED, NOT_FINITE, OK, REASONS


def finite(name: str, values: ArrayLike, shape: tuple[int, ...], absent: float | None = None) -> Vector:
    """An argument of this shape as doubles; ValueError names the first that is NaN or infinite, except for the value of
    an absent bound."""
    array = shaped(name, values, shape)
    refused = np.argwhere(~np.isfinite(array) & (array != absent)).tolist()
    if refused:
        raise ValueError(f"{name}{refused[0]} must be finite, not {array[tuple(refused[0])]}")
    return array


def check_status(status: int, prefix: str = "", **data: Matrix | None) -> None:
    """Raise ValueError unless the status is that of an answer or of good data; the data are those that it is about."""
    infinite = [name for name, array in data.items() if array is not None and not np.isfinite(array).all()]
    infinite += ["P scaled"] * (status == NOT_FINITE and bool(data))
    if status not in (OK, CAPPED):
        raise ValueError(prefix + (f"{infinite[0]} must be finite" if infinite else REASONS[status]))
