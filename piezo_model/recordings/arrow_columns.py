"""Columns of Arrow as arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from piezo_model.recordings.tables import Column, Kind


def column_of(field: pa.Field, rows: int) -> Column:
    """A column of a table of so many rows."""
    kinds: dict[Kind, Sequence[bool]] = {
        "number": (pa.types.is_floating(field.type), pa.types.is_integer(field.type), pa.types.is_decimal(field.type)),
        "flag": (pa.types.is_boolean(field.type),),
        "clock": (pa.types.is_temporal(field.type) and not pa.types.is_date(field.type),),
    }
    return Column.named(field.name, kind=next((kind for kind, fits in kinds.items() if any(fits)), "text"), rows=rows)


def arrays_of(batch: pa.RecordBatch) -> list[NDArray[Any]]:
    """Columns of a batch as arrays, times as datetime64 or timedelta64."""
    return [times(column) if pa.types.is_temporal(column.type) else numbers(column) for column in batch.columns]


def numbers(column: pa.Array) -> NDArray[Any]:
    """A column of numbers as an array, NaN where a value is missing."""
    if column.null_count or pa.types.is_decimal(column.type):
        column = column.cast(pa.float64(), safe=False).fill_null(math.nan)
    return np.asarray(np.from_dlpack(column))  # to_numpy would import pandas


def times(column: pa.Array) -> NDArray[Any]:
    """A column of points in time (datetime64), durations or times of day (timedelta64), NaT where a value is
    missing."""
    whole = column.cast(pa.int32() if column.type.bit_width == 32 else pa.int64()).cast(pa.int64())
    kind = "M" if pa.types.is_timestamp(column.type) else "m"
    return numbers(whole.fill_null(np.iinfo(np.int64).min)).view(f"{kind}8[{column.type.unit}]")
