"""Columns of the tables of a run, each with its type, its aggregate, its heading and its format.

A race has one list of them, from which its rows, its summary and its tables follow. The columns by which rows are
sorted are their key: it is complete, and unique to a row.

The statistics of all races have one definition each, which tables, sentences and plots share. The time of an answer is
that of update and solve of the same call (`bench.timing.clock.answers_us`), so what is shown is a median of sums and
never a sum of medians. It is the median of the calls of a task, then of its repeats, and then of the problems. A
percentile is that of all calls of all tasks in question together (`bench.timing.percentiles`), and never a
mean of percentiles. Of accuracies, the worst counts.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import parquet

from bench.messages.task import Start, Tier, Timed
from piezo_model.checks import check, refusing
from piezo_model.json_file import FileName, decoded
from solvers.protocol import Lane

TEXT, COUNT, FLAG, NUMBER = pa.large_string(), pa.int64(), pa.bool_(), pa.float64()
NUMBERS = pa.list_(NUMBER)
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
            "what",
            "host",
            "machine",
        ),
        TEXT,
    ),
    **dict.fromkeys(("d", "rung", "repeat", "samples", "iterations", "preemptions", "core"), COUNT),
    **dict.fromkeys(("is_default", "mutates_input", "repeatable"), FLAG),
    "ns": pa.list_(pa.int64()),
}
"""Types of columns that several tables share; any other column holds doubles, unless its type is given."""
CHOICES = {
    "lane": tuple(Lane),
    "tier": tuple(Tier),
    "scaling": ("scaled", "raw"),
    "start": get_args(Start),
    "timed": get_args(Timed),
}
PATTERNS = {column: f"^({'|'.join(choices)})$" for column, choices in CHOICES.items()} | dict.fromkeys(
    ("problem_set", "problem", "solver"), get_args(FileName)[1].pattern
)
"""What the texts of a column match: one of the choices, or a part of the name of a file."""

TYPICAL = "median"
"""Of times, those that are known."""


def typical_of_all(values: pd.Series) -> float:
    """The median; NaN if any value is missing, so that the fast problems do not stand for all."""
    return float(values.median(skipna=False))


def worst(values: pd.Series) -> float:
    """The largest value, or NaN if any is NaN: a failed problem must not look like an accurate one."""
    return float(values.max(skipna=False))


def first_text(texts: pd.Series) -> str:
    """The first text that is not empty; "" if there is none."""
    return next((str(text) for text in texts if text), "")


@dataclass(frozen=True)
class Column:
    """A column of the rows of a race, of its summary, of its tables, or of several of these."""

    name: Any
    """Text, except in a table with a column for each value of another, such as a number of unknowns."""
    type: pa.DataType | None = NUMBER
    """Type in the rows; None for a column of the summary alone."""
    aggregate: Any = None
    """How pandas combines the rows of a line of the summary, by name or function; None if it does not."""
    heading: str = ""
    """Heading in a table; "" if it is in none."""
    format: Callable[[Any], str] = str
    of: str = ""
    """The column of the rows that is combined, if it has another name."""


def named(*names: str) -> tuple[Column, ...]:
    """Columns of the rows alone, of the types that tables share."""
    return tuple(Column(name, SHARED.get(name, NUMBER)) for name in names)


def schema(columns: Iterable[Column]) -> pa.Schema:
    """The columns of the rows with their types."""
    return pa.schema([(column.name, column.type) for column in columns if column.type is not None])


def combined(rows: pd.DataFrame, columns: Iterable[Column], by: Sequence[str]) -> pd.DataFrame:
    """One row for each combination of values in the columns ``by``, with the columns that have an aggregate."""
    aggregates = {column.name: (column.of or column.name, column.aggregate) for column in columns if column.aggregate}
    return rows.groupby([*by], dropna=False).agg(**aggregates).reset_index()


def read(path: Path, expected: pa.Schema, key: Sequence[str] = ()) -> pd.DataFrame:
    """The columns of a schema from a Parquet file; ``key`` are those that identify a row. ValueError, without
    the path, if they do not fit."""
    try:
        with parquet.ParquetFile(path) as file:
            for column in expected.names:
                check(column in file.schema_arrow.names, f"has no column {column!r}")
            table = file.read(expected.names)
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise ValueError(f"cannot be read ({error})") from None
    check(table.num_rows or not key, "has no rows")
    table = pa.table([_checked(table[field.name], field) for field in expected], expected)
    for column in key:
        row = pc.index(pc.is_null(table[column]), True).as_py() + 1
        check(not row, f"column {column!r} is empty in row {row}")
    frame: pd.DataFrame = table.to_pandas()
    if key and (twice := frame.duplicated(list(key))).any():
        raise ValueError(f"row {int(twice.argmax()) + 1} occurs twice")
    return frame


def _checked(values: pa.ChunkedArray, field: pa.Field) -> pa.ChunkedArray:
    """The values cast to the type of the field; ValueError if they do not fit."""
    column, expected, actual = field.name, field.type, values.type
    fits = (
        pa.types.is_null(actual)
        or actual.equals(expected)
        or (pa.types.is_large_string(expected) and (pa.types.is_string(actual) or pa.types.is_dictionary(actual)))
        or (pa.types.is_int64(expected) and pa.types.is_integer(actual))
        or (pa.types.is_floating(expected) and (pa.types.is_integer(actual) or pa.types.is_floating(actual)))
    )
    try:
        if not fits:
            raise pa.ArrowInvalid
        values = values.cast(expected)
    except pa.ArrowException:
        raise ValueError(f"column {column!r} has type {actual}, expected {expected}") from None
    least = -1 if expected.equals(COUNT) else 0 if {"us", "ns"} & set(column.split("_")) else None
    lowest = (
        None if least is None else pc.min(pc.list_flatten(values) if pa.types.is_list(expected) else values).as_py()
    )
    check(
        lowest is None or not lowest < least,
        f"column {column!r} holds {lowest}, below the least possible value {least}",
    )
    if column in ("setting", "settings"):
        with refusing(ValueError, f"column {column!r} holds text that is not settings in JSON: "):
            _ = [decoded(text or "", dict[str, Any]) for text in values.unique().to_pylist()]
    if column in PATTERNS and (at := pc.index(pc.match_substring_regex(values, PATTERNS[column]), False).as_py()) >= 0:
        expected = f"one of {', '.join(CHOICES[column])}" if column in CHOICES else "a name for a file"
        raise ValueError(f"column {column!r} holds {values[at].as_py()!r:.60} in row {at + 1}, not {expected}")
    return values
