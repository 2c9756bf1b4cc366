"""Columns of Arrow as arrays: numbers, times, and clocks as text (12:34:56.789, 2024-01-31T12:34:56.789+01:00,
31.01.2024 12:34:56,789), exact to the nanosecond.

A column has one form: all of its clocks have a date or none has, and likewise an offset from UTC, which is
subtracted. The order of day and month does not change the elapsed time until the date changes. The first new date
determines the order for the whole column: it must be a valid date, and of two possible dates the next one is taken. So
no order is guessed in advance, and a column is read in one pass.
"""

import math
import re
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from piezo_model.recordings.chunks import RecordingError
from piezo_model.recordings.tables import Column, Kind
from solvers.arrays import Vector

_GAP = "[\\s\u00a0\u202f]*"
_DATE = (
    rf"(?:(?P<date>\d{{4}}[-./]\d{{1,2}}[-./]\d{{1,2}}|\d{{1,2}}[-./]\d{{1,2}}[-./]\d{{4}})(?:[T_\s]+|{_GAP},{_GAP}))?"
)
_TIME = r"(?P<first>\d{1,2}):(?P<second>[0-5]\d)(?::(?P<third>[0-5]?\d))?(?:[.,:](?P<fraction>\d+))?"
CLOCK = re.compile(
    rf"^{_GAP}{_DATE}{_TIME}{_GAP}(?P<half>[AaPp][Mm])?{_GAP}(?P<zone>Z|UTC|[+-]\d{{2}}(?::?\d{{2}})?)?{_GAP}$"
)
DOTTED_CLOCK = re.compile(r"^\s*(\d{1,2})\.([0-5]\d)\.([0-5]\d(?:\.\d+)?)\s*$")
ORDERS = ("%Y-%m-%d", "%d-%m-%Y", "%m-%d-%Y")
HALVES = {"": -1, "AM": 0, "PM": 12}
SECOND, DAY = 10**9, 86400 * 10**9
"""Durations in nanoseconds."""


def column_of(field: pa.Field, rows: int | None = None) -> Column:
    """A column of a table."""
    kind: Kind = "text"
    if pa.types.is_floating(field.type) or pa.types.is_integer(field.type) or pa.types.is_decimal(field.type):
        kind = "number"
    elif pa.types.is_boolean(field.type):
        kind = "flag"
    elif pa.types.is_temporal(field.type) and not pa.types.is_date(field.type):
        kind = "clock"
    return Column.named(field.name, kind=kind, rows=rows)


def arrays_of(batch: pa.RecordBatch) -> list[NDArray[Any]]:
    """Columns of a batch as arrays, times as datetime64 or timedelta64."""
    return [times(column) if pa.types.is_temporal(column.type) else numbers(column) for column in batch.columns]


def numbers(column: pa.Array) -> NDArray[Any]:
    """A column of numbers as an array; missing values are NaN."""
    if column.null_count or pa.types.is_decimal(column.type):
        column = column.cast(pa.float64(), safe=False).fill_null(math.nan)
    return np.asarray(np.from_dlpack(column))  # to_numpy would import pandas


def times(column: pa.Array) -> NDArray[Any]:
    """A column of points in time (datetime64), durations or times of day (timedelta64); missing values are NaT."""
    whole = column.cast(pa.int32() if column.type.bit_width == 32 else pa.int64()).cast(pa.int64())
    kind = "M" if pa.types.is_timestamp(column.type) else "m"
    return numbers(whole.fill_null(np.iinfo(np.int64).min)).view(f"{kind}8[{column.type.unit}]")


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day, with or without a date."""
    return bool(CLOCK.match(cell) or DOTTED_CLOCK.match(cell))


class ClockReader:
    """Times of a text column, over any number of chunks.

    Error messages start with the label; ``where`` names a row counted from 0.
    """

    def __init__(self, label: str, where: Callable[[int], str]) -> None:
        self.label, self.where = label, where
        self._count, self._example = 0, ""
        self._date: str | None = None
        self._zone: str | None = None
        """Date and offset of the first cell, "" for none."""
        self._orders: tuple[str, ...] = ORDERS
        """Orders that agree with the dates so far."""
        self._minutes: bool | None = None
        """Whether a clock of two numbers has minutes and seconds: some of the first ones have a fraction."""

    def times(self, cells: Sequence[str | None]) -> NDArray[Any]:
        """Times of the next chunk, as datetime64 since the first date or timedelta64 since midnight; missing cells are
        NaT. RecordingError for a cell that is not a time in the column's form."""
        at = np.array([k for k, cell in enumerate(cells) if cell], dtype=int)
        result = np.full(len(cells), np.iinfo(np.int64).min)  # NaT
        if at.size:
            self._example = self._example or str(cells[at[0]])
            plain = pc.replace_substring_regex(
                pa.array([cells[k] for k in at], pa.string()), DOTTED_CLOCK.pattern, r"\1:\2:\3"
            )
            parts = pc.extract_regex(plain, CLOCK.pattern)
            wrong = pc.index(parts.is_null(), True).as_py()
            if wrong < 0:
                days, offsets = _mapped(parts, "date", self._day), _mapped(parts, "zone", self._offset)
                wrong = next(iter(np.flatnonzero(np.isnan(days + offsets)).tolist()), -1)
            if wrong >= 0:
                cell, row = str(cells[at[wrong]]), self._count + int(at[wrong])
                like = f" like {self._example!r}" if cell != self._example else ""
                raise RecordingError(f"{self.label} holds {cell!r} in {self.where(row)}, where a clock{like} is needed")
            result[at] = self._times_of_day(parts) + (days * DAY - offsets * SECOND).astype(np.int64)
        self._count += len(cells)
        return result.view("M8[ns]" if self._date else "m8[ns]")

    def _times_of_day(self, parts: pa.StructArray) -> NDArray[np.int64]:
        """Nanoseconds since midnight."""
        first, second, third = (_integers(pc.struct_field(parts, name)) for name in ("first", "second", "third"))
        half = _mapped(parts, "half", lambda text: HALVES[text.upper()]).astype(np.int64)
        fraction = pc.struct_field(parts, "fraction")
        short = third < 0
        if self._minutes is None and short.any():
            self._minutes = bool((numbers(pc.utf8_length(fraction))[short] > 0).any())
        minutes = np.where(half < 0, first, first % 12 + half) * 60 + second
        seconds = np.where(short & bool(self._minutes), minutes, 60 * minutes + np.maximum(third, 0))
        return seconds * SECOND + _integers(pc.utf8_slice_codeunits(pc.utf8_rpad(fraction, 9, "0"), 0, 9))

    def _day(self, date: str) -> float:
        """Days since the first date; NaN for a date that does not fit the column."""
        if self._date is None:
            self._date = date
        if not date or not self._date:
            return 0.0 if date == self._date else math.nan
        days: dict[str, int] = {}
        for order in self._orders:
            try:
                moment, start = (datetime.strptime(re.sub("[./]", "-", text), order) for text in (date, self._date))
            except ValueError:  # no such month or day
                continue
            days[order] = (moment - start).days
        if date == self._date:
            self._orders = tuple(days)
        elif days:
            self._orders = (min(days, key=lambda order: (days[order] < 0, abs(days[order]))),)
        return days[self._orders[0]] if days else math.nan

    def _offset(self, zone: str) -> float:
        """Offset of a clock from UTC in seconds; NaN unless all clocks of the column have one, or none has."""
        if self._zone is None:
            self._zone = zone
        try:
            ahead = datetime.fromisoformat(f"1970-01-01T00:00{zone.replace('UTC', 'Z')}").utcoffset()
        except ValueError:
            return math.nan
        return (ahead or timedelta()).total_seconds() if bool(zone) == bool(self._zone) else math.nan


def _mapped(parts: pa.StructArray, name: str, value: Callable[[str], float]) -> Vector:
    """A function of every text of a part, called once for each distinct text in the order of their appearance."""
    coded = pc.struct_field(parts, name).dictionary_encode()
    values: Vector = np.array([value(text) for text in coded.dictionary.to_pylist()], dtype=np.float64)
    return values[numbers(coded.indices)]


def _integers(texts: pa.StringArray) -> NDArray[np.int64]:
    """Integers; −1 for an empty text."""
    return numbers(pc.if_else(pc.equal(texts, ""), "-1", texts).cast(pa.int64()))
