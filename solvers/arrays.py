"""Types of arrays; shapes are documented where the arrays are used."""

import ctypes
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Index = NDArray[np.int64]
Nanoseconds = NDArray[np.int64]
Mask = NDArray[np.bool_]


def reals(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """An argument as doubles in C order, NaN where it is masked; ValueError if it is not made of real numbers."""
    try:
        array = np.asarray(
            np.ma.filled(values.astype(float), np.nan)
            if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "fiub"
            else values
        )
    except ValueError:  # lists of different lengths
        array = np.empty(0, dtype=object)
    if array.dtype.kind not in "fiub":
        kind = type(values).__name__ if array.dtype == object else array.dtype
        raise ValueError(f"{name} must hold real numbers, not {kind}")
    return np.asarray(array, dtype=np.float64, order="C")


def shaped(name: str, values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """An argument of this shape as doubles in C order, itself if it is that; ValueError if it is not."""
    if type(values) is np.ndarray and values.dtype == np.float64 and values.flags.c_contiguous:
        array = values
    else:
        array = reals(name, values)
    if array.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
    return array


def product(M: Any, x: Vector) -> Vector:
    """M x (m,) for a dense or sparse matrix (m, d), each sum with one rounding at its end and so the same on every
    machine; BLAS adds in an order of its own. Infinite only if a sum is, not if a term of it is.

    >>> product(np.array([[1e16, 1.0, -1e16]]), np.ones(3))
    array([1.])
    >>> product(np.array([[2.0, -2.0]]), np.full(2, 1e308))
    array([0.])
    """
    scale = float(np.exp2(np.frexp(np.abs(x).max(initial=1.0))[1] - 1))  # powers of two change no bit
    dense = M if isinstance(M, np.ndarray) else M.toarray()
    return np.array([math.fsum(row) * scale for row in (dense * (x / scale)).tolist()])


def read_only(values: ArrayLike) -> NDArray[np.float64]:
    """A copy, as an array of doubles that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


def address(array: NDArray[Any] | None) -> ctypes.c_void_p:
    """Address of an array for a C function that reads or writes it; NULL for None."""
    return ctypes.c_void_p(None if array is None else array.ctypes.data)
