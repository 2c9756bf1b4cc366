"""Columns of Arrow as arrays: numbers, times, and clocks as text (12:34:56.789, 2024-01-31T12:34:56.789+01:00,
31.01.2024 12:34:56,789), exact to the nanosecond.

A column is written in one form: all of its clocks have a date or none has, and so with an offset from UTC, which
counts. Whether day or month comes first makes no difference to the time that has passed for as long as the date stays
the same. Where it first changes, the order is settled for the whole column: by what is a date at all, and of two by the
one that comes next. So no order is ever guessed, and a column is read in one pass.
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
"""In nanoseconds."""


def column_of(field: pa.Field, rows: int | None = None) -> Column:
    """A column of a table, of so many rows if that is known."""
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


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day, with or without a date."""
    return bool(CLOCK.match(cell) or DOTTED_CLOCK.match(cell))


class ClockReader:
    """Times of a column, over any number of pieces.

    The sentence of an error starts with the label; ``where`` names a row counted from 0.
    """

    def __init__(self, label: str, where: Callable[[int], str]) -> None:
        """Start before the first cell."""
        self.label, self.where = label, where
        self._count, self._example = 0, ""
        self._date: str | None = None
        self._zone: str | None = None
        """Of the first cell, "" for none."""
        self._orders: tuple[str, ...] = ORDERS
        """That the dates so far leave open."""
        self._minutes: bool | None = None
        """Whether a clock of two numbers has minutes and seconds: some of the first ones have a fraction."""

    def times(self, cells: Sequence[str | None]) -> NDArray[Any]:
        """Times of the next piece, datetime64 from the first date on or timedelta64 since midnight, NaT where a cell
        is missing; RecordingError for a cell that is not a time in the column's form."""
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
                days, offsets = _each(parts, "date", self._day), _each(parts, "zone", self._offset)
                wrong = next(iter(np.flatnonzero(np.isnan(days + offsets)).tolist()), -1)
            if wrong >= 0:
                raise RecordingError(self._refusal(str(cells[at[wrong]]), self._count + int(at[wrong])))
            result[at] = self._times_of_day(parts) + (days * DAY - offsets * SECOND).astype(np.int64)
        self._count += len(cells)
        return result.view("M8[ns]" if self._date else "m8[ns]")

    def _times_of_day(self, parts: pa.StructArray) -> NDArray[np.int64]:
        """Nanoseconds since midnight."""
        first, second, third = (_whole(pc.struct_field(parts, name)) for name in ("first", "second", "third"))
        half, fraction = (
            _each(parts, "half", lambda text: HALVES[text.upper()]).astype(np.int64),
            pc.struct_field(parts, "fraction"),
        )
        short = third < 0
        if self._minutes is None and short.any():
            self._minutes = bool((numbers(pc.utf8_length(fraction))[short] > 0).any())
        minutes = np.where(half < 0, first, first % 12 + half) * 60 + second
        seconds = np.where(short & bool(self._minutes), minutes, 60 * minutes + np.maximum(third, 0))
        return seconds * SECOND + _whole(pc.utf8_slice_codeunits(pc.utf8_rpad(fraction, 9, "0"), 0, 9))

    def _day(self, date: str) -> float:
        """Days since the first date, NaN where the column has no such date."""
        if self._date is None:
            self._date = date
        if not date or not self._date:
            return 0.0 if date == self._date else math.nan
        days: dict[str, int] = {}
        for order in self._orders:
            try:
                moment, start = (datetime.strptime(re.sub("[./]", "-", each), order) for each in (date, self._date))
            except ValueError:  # no such month or day
                continue
            days[order] = (moment - start).days
        if date == self._date:
            self._orders = tuple(days)
        elif days:
            self._orders = (min(days, key=lambda order: (days[order] < 0, abs(days[order]))),)
        return days[self._orders[0]] if days else math.nan

    def _offset(self, zone: str) -> float:
        """Seconds that a clock is ahead of UTC, NaN where the other clocks do not say it or the other way round."""
        if self._zone is None:
            self._zone = zone
        try:
            ahead = datetime.fromisoformat(f"1970-01-01T00:00{zone.replace('UTC', 'Z')}").utcoffset()
        except ValueError:
            return math.nan
        return (ahead or timedelta()).total_seconds() if bool(zone) == bool(self._zone) else math.nan

    def _refusal(self, cell: str, row: int) -> str:
        like = f" like {self._example!r}" if cell != self._example else ""
        return f"{self.label} holds {cell!r} in {self.where(row)}, where a clock{like} is needed"


def _each(parts: pa.StructArray, name: str, value: Callable[[str], float]) -> Vector:
    """A value for each text of a part, asked for once for each of the few that there are, in the order in which they
    come."""
    coded = pc.struct_field(parts, name).dictionary_encode()
    values: Vector = np.array([value(text) for text in coded.dictionary.to_pylist()], dtype=np.float64)[
        numbers(coded.indices)
    ]
    return values


def _whole(texts: pa.StringArray) -> NDArray[np.int64]:
    """Whole numbers, −1 where there is none."""
    return numbers(pc.if_else(pc.equal(texts, ""), "-1", texts).cast(pa.int64()))
