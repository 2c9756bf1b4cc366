"""Tables of a run: the type of a column follows from its name, and one that is not listed here holds doubles.

Rows are named by the columns by which they are sorted; no two may have the same name, and no part of a name may be
missing.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import parquet

from piezo_model.json_file import decoded
from solvers.protocol import Lane, Tier

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
            "settings",
            "status",
            "message",
            "basis",
            "what",
            "host",
        ),
        TEXT,
    ),
    **dict.fromkeys(("d", "rung", "repeat", "samples", "iterations", "preemptions", "core"), COUNT),
    **dict.fromkeys(("is_default", "mutates_input", "repeatable"), FLAG),
    "ns": pa.list_(pa.int64()),
}
"""Of columns that several tables have; a kind of race says itself of what type others of its table are."""
CHOICES = {"lane": tuple(Lane), "tier": tuple(Tier), "scaling": ("scaled", "raw"), "start": ("cold", "warm")}


class TableError(ValueError):
    """A file that does not hold the table; the message is one sentence without its path."""


def schema(columns: Sequence[str], more: Mapping[str, pa.DataType] = MappingProxyType({})) -> pa.Schema:
    """The types of columns; ``more`` are those of one table alone."""
    return pa.schema([(name, more.get(name, SHARED.get(name, pa.float64()))) for name in columns])


def read(path: Path, wanted: pa.Schema, name: Sequence[str] = ()) -> pd.DataFrame:
    """The table in a Parquet file; TableError says what is wrong with it.

    The wanted columns must be there, and others are passed over; those of ``name`` name a row.
    """
    try:
        with parquet.ParquetFile(path) as file:
            if missing := [column for column in wanted.names if column not in file.schema_arrow.names]:
                raise TableError(f"has no column {missing[0]!r}")
            table = file.read(wanted.names)
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise TableError(f"cannot be read ({error})") from None
    if name and not table.num_rows:
        raise TableError("has no rows")
    table = pa.table([_checked(table[field.name], field) for field in wanted], wanted)
    for column in name:
        if table[column].null_count:
            raise TableError(
                f"column {column!r} is empty in row {pc.index(pc.is_null(table[column]), True).as_py() + 1}"
            )
    found: pd.DataFrame = table.to_pandas()
    if name and (twice := found.duplicated(list(name))).any():
        raise TableError(f"row {int(twice.argmax()) + 1} is there twice")
    return found


def _checked(values: pa.ChunkedArray, field: pa.Field) -> pa.ChunkedArray:
    """The values in the type of the field, where they are of its kind."""
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
    found = None if least is None else pc.min(pc.list_flatten(values) if pa.types.is_list(wanted) else values).as_py()
    if found is not None and found < least:
        raise TableError(f"column {column!r} holds {found:g}, and nothing below {least} can be there")
    if column == "settings":
        try:
            _ = [decoded(text, dict[str, Any]) for text in values.unique().to_pylist()]
        except (ValueError, TypeError) as error:
            raise TableError(f"column 'settings' holds text that no settings are: {error}") from None
    if column in CHOICES:
        for value in values.unique().to_pylist():
            if value is not None and value not in CHOICES[column]:
                raise TableError(f"column {column!r} holds {value!r:.60} and not one of {', '.join(CHOICES[column])}")
    return values
