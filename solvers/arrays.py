"""Types of arrays; their shapes are said where they are used."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Index = NDArray[np.int64]
Nanoseconds = NDArray[np.int64]
Mask = NDArray[np.bool_]


def address(array: NDArray[Any]) -> ctypes.c_void_p:
    """Where an array begins, for a C function that reads or writes it."""
    return ctypes.c_void_p(array.ctypes.data)
