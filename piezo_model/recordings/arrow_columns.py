"""Columns of Arrow as float64 arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from piezo_model.recordings.pieces import Elapsed
from solvers.arrays import Matrix


def matrix_of(batch: pa.RecordBatch, clocks: Sequence[Elapsed]) -> Matrix:
    """Columns of numbers of a batch as an array of its own, shape (columns, rows), NaN where a value is missing.

    Points in time and durations become seconds since the first; there is a clock for each column.
    """
    rows = np.empty((batch.num_columns, batch.num_rows))
    for row, column, clock in zip(rows, batch.columns, clocks, strict=True):
        if pa.types.is_temporal(column.type):
            row[:] = clock.seconds(times(column))
        else:
            row[:] = numbers(column.cast(pa.float64()) if pa.types.is_decimal(column.type) else column)
    return rows


def numbers(column: pa.Array) -> NDArray[Any]:
    """A column of numbers as an array, NaN where a value is missing."""
    if column.null_count:
        column = column.cast(pa.float64(), safe=False).fill_null(math.nan)
    return np.asarray(np.from_dlpack(column))  # to_numpy would import pandas


def times(column: pa.Array) -> NDArray[Any]:
    """A column of points in time (datetime64), durations or times of day (timedelta64), NaT where a value is
    missing."""
    whole = column.cast(pa.int32() if column.type.bit_width == 32 else pa.int64()).cast(pa.int64())
    kind = "M" if pa.types.is_timestamp(column.type) else "m"
    return numbers(whole.fill_null(np.iinfo(np.int64).min)).view(f"{kind}8[{column.type.unit}]")
