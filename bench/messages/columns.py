"""Columns of the tables of a run: the type of a column follows from its name; columns that are not listed hold doubles.

The columns by which rows are sorted are their key: it is complete, and unique to a row.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_args

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import parquet

from bench.messages.task import Start, Timed
from bench.messages.verdict import Tier
from piezo_model.json_file import decoded
from solvers.protocol import Lane

TEXT, COUNT, FLAG = pa.large_string(), pa.int64(), pa.bool_()
SHARED = {
    **dict.fromkeys(
        (
            "task",
            "problem_set",
            "problem",
            "solver",
            "lane",
            "tier",
            "setting",
            "scaling",
            "start",
            "timed",
            "settings",
            "status",
            "message",
            "basis",
            "what",
            "host",
        ),
        TEXT,
    ),
    **dict.fromkeys(("d", "rung", "session", "repeat", "samples", "iterations", "preemptions", "core"), COUNT),
    **dict.fromkeys(("is_default", "mutates_input", "repeatable"), FLAG),
    "ns": pa.list_(pa.int64()),
}
"""Types of columns that several tables share; a kind of race declares those of its own columns."""
CHOICES = {
    "lane": tuple(Lane),
    "tier": tuple(Tier),
    "scaling": ("scaled", "raw"),
    "start": get_args(Start),
    "timed": get_args(Timed),
}


class TableError(ValueError):
    """A file does not hold the expected table; the message is one sentence without its path."""


def schema(columns: Sequence[str], more: Mapping[str, pa.DataType] = MappingProxyType({})) -> pa.Schema:
    """The columns with their types; ``more`` are types of a single table."""
    return pa.schema([(name, more.get(name, SHARED.get(name, pa.float64()))) for name in columns])


def read(path: Path, wanted: pa.Schema, key: Sequence[str] = ()) -> pd.DataFrame:
    """The wanted columns of a Parquet file; ``key`` are those that identify a row. TableError if they do not fit."""
    try:
        with parquet.ParquetFile(path) as file:
            if missing := [column for column in wanted.names if column not in file.schema_arrow.names]:
                raise TableError(f"has no column {missing[0]!r}")
            table = file.read(wanted.names)
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise TableError(f"cannot be read ({error})") from None
    if key and not table.num_rows:
        raise TableError("has no rows")
    table = pa.table([_checked(table[field.name], field) for field in wanted], wanted)
    for column in key:
        if table[column].null_count:
            raise TableError(
                f"column {column!r} is empty in row {pc.index(pc.is_null(table[column]), True).as_py() + 1}"
            )
    frame: pd.DataFrame = table.to_pandas()
    if key and (twice := frame.duplicated(list(key))).any():
        raise TableError(f"row {int(twice.argmax()) + 1} occurs twice")
    return frame


def _checked(values: pa.ChunkedArray, field: pa.Field) -> pa.ChunkedArray:
    """The values cast to the type of the field; TableError if they do not fit."""
    column, wanted, given = field.name, field.type, values.type
    fits = (
        pa.types.is_null(given)
        or given.equals(wanted)
        or (pa.types.is_large_string(wanted) and (pa.types.is_string(given) or pa.types.is_dictionary(given)))
        or (pa.types.is_int64(wanted) and pa.types.is_integer(given))
        or (pa.types.is_floating(wanted) and (pa.types.is_integer(given) or pa.types.is_floating(given)))
    )
    try:
        if not fits:
            raise pa.ArrowInvalid
        values = values.cast(wanted)
    except pa.ArrowException:
        raise TableError(f"column {column!r} holds {given} and not {wanted}") from None
    least = -1 if wanted.equals(COUNT) else 0 if {"us", "ns"} & set(column.split("_")) else None
    lowest = None if least is None else pc.min(pc.list_flatten(values) if pa.types.is_list(wanted) else values).as_py()
    if lowest is not None and lowest < least:
        raise TableError(f"column {column!r} holds {lowest:g}, and the least possible value is {least}")
    if column in ("setting", "settings"):
        try:
            _ = [decoded(text, dict[str, Any]) for text in values.unique().to_pylist()]
        except (ValueError, TypeError) as error:
            raise TableError(f"column {column!r} holds text that is not settings in JSON: {error}") from None
    if column in CHOICES:
        for value in values.unique().to_pylist():
            if value is not None and value not in CHOICES[column]:
                raise TableError(f"column {column!r} holds {value!r:.60} and not one of {', '.join(CHOICES[column])}")
    return values
