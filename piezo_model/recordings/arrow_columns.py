"""Columns of Arrow as float64 arrays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from solvers.arrays import Matrix

PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def matrix_of(batch: pa.RecordBatch) -> Matrix:
    """Columns of numbers of a batch as an array of its own, shape (columns, rows), NaN where a value is missing.

    Points in time and durations become seconds.
    """
    rows = np.empty((batch.num_columns, batch.num_rows))
    for row, column in zip(rows, batch.columns, strict=True):
        if pa.types.is_temporal(column.type):
            row[:] = numbers(column.cast(pa.int32() if column.type.bit_width == 32 else pa.int64()))
            row /= PER_SECOND[column.type.unit]
        else:
            row[:] = numbers(column.cast(pa.float64()) if pa.types.is_decimal(column.type) else column)
    return rows


def numbers(column: pa.Array) -> NDArray[Any]:
    """A column of numbers as an array, NaN where a value is missing."""
    if column.null_count:
        column = column.cast(pa.float64(), safe=False).fill_null(math.nan)
    return np.asarray(np.from_dlpack(column))  # to_numpy would import pandas
