"""Clocks as text (12:34:56.789, 2024-01-31T12:34:56.789+01:00, 31.01.2024 12:34:56,789), exact to the nanosecond.

A column has one form: all of its clocks have a date, or none has, and all have the same offset from UTC, or none. Of
the orders of day and month for which most dates are valid, the one with the shortest path through the dates is chosen.
"""

import math
import re
from collections.abc import Sequence
from datetime import datetime
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from piezo_model.recordings.table import RecordingError, RowName

_GAP = "[\\s\u00a0\u202f]*"
_DATE = (
    rf"(?:(?P<date>\d{{4}}[-./]\d{{1,2}}[-./]\d{{1,2}}|\d{{1,2}}[-./]\d{{1,2}}[-./]\d{{4}})(?:[T_\s]+|{_GAP},{_GAP}))?"
)
_TIME = r"(?P<first>\d{1,2}):(?P<second>[0-5]\d)(?::(?P<third>[0-5]?\d))?(?:[.,:](?P<fraction>\d+))?"
CLOCK = re.compile(
    rf"^{_GAP}{_DATE}{_TIME}{_GAP}(?P<half>[AaPp][Mm])?{_GAP}(?P<zone>Z|UTC|[+-](?:[01]\d|2[0-3])(?::?[0-5]\d)?)?{_GAP}$"
)
DOTTED_CLOCK = re.compile(r"^\s*(\d{1,2})\.([0-5]\d)\.([0-5]\d(?:\.\d+)?)\s*$")
ORDERS = ("%Y-%m-%d", "%d-%m-%Y", "%m-%d-%Y")
FIELDS = ("first", "second", "third", "fraction", "half", "date", "zone")
SECOND, DAY = 10**9, 86400 * 10**9
"""Durations in nanoseconds."""


def is_clock(cell: str) -> bool:
    """True if a cell is a time of day, with or without a date."""
    return bool(CLOCK.match(cell) or DOTTED_CLOCK.match(cell))


def times(chunks: Sequence[pa.StringArray], label: str, where: RowName) -> NDArray[Any]:
    """Times of a column: datetime64 since the first date, or timedelta64 since midnight; missing cells are NaT.

    Error messages start with the label; ``where`` names a row counted from 0.

    Raises
    ------
    RecordingError
        A cell is not a time in the column's form.
    """
    dates, zones = {"": 0}, {"": 0}
    read = [_of_day(chunk, dates, zones) for chunk in chunks]
    of_day, short, date, zone, known = (np.concatenate(arrays) for arrays in zip(*read, strict=True))
    if short.any() and (of_day[short] % SECOND > 0).any():  # a fraction shows that two numbers are minutes and seconds
        seconds, fraction = np.divmod(of_day[short], 60 * SECOND)
        of_day[short] = (seconds + 3600 * np.cumsum(np.diff(seconds, prepend=0) < -1800)) * SECOND + fraction
    first = int(np.argmax(known))
    days = _days(list(dates), int(date[first]))[date]
    wrong = np.flatnonzero(known & (np.isnan(days) | (zone != zone[first]) | (of_day < 0)))
    if wrong.size:
        cells, row = pa.chunked_array(chunks), int(wrong[0])
        cell, example = cells[row].as_py(), cells[first].as_py()
        like = f" like {example!r}" if example != cell else ""
        raise RecordingError(f"{label} holds {cell!r} in {where(row)}, where a clock{like} is needed")
    result = np.full(known.size, np.iinfo(np.int64).min)  # NaT
    result[known] = of_day[known] + (days * DAY)[known].astype(np.int64)
    return result.view("M8[ns]" if date[first] else "m8[ns]")


def _of_day(chunk: pa.StringArray, dates: dict[str, int], zones: dict[str, int]) -> tuple[NDArray[Any], ...]:
    """Nanoseconds since midnight, −1 for a cell that is not a clock; whether it has only two numbers; codes of its date
    and of its offset from UTC, which are added to the dictionaries; and whether the cell is not empty."""
    fields = pc.extract_regex(pc.replace_substring_regex(chunk, DOTTED_CLOCK.pattern, r"\1:\2:\3"), CLOCK.pattern)
    text = {name: pc.fill_null(pc.struct_field(fields, name), "") for name in FIELDS}
    first, second, third = (_integers(text[name]) for name in FIELDS[:3])
    half = _coded(pc.ascii_upper(text["half"]), {"": 0, "AM": 1, "PM": 2})
    minutes = np.where(half > 0, first % 12 + 12 * (half == 2), first) * 60 + second
    fraction = _integers(pc.utf8_slice_codeunits(pc.utf8_rpad(text["fraction"], 9, "0"), 0, 9))
    nanoseconds = (60 * minutes + np.maximum(third, 0)) * SECOND + fraction
    valid = np.asarray(pc.is_valid(fields))
    return (
        np.where(valid, nanoseconds, -1),
        valid & (third < 0),
        _coded(text["date"], dates),
        _coded(text["zone"], zones),
        ~np.asarray(pc.equal(pc.fill_null(chunk, ""), "")),
    )


def _days(dates: list[str], first: int) -> NDArray[np.float64]:
    """Days of the distinct dates since the first one; NaN for a date that does not fit, or where one is missing."""
    if not dates[first]:
        return np.array([math.nan if date else 0.0 for date in dates])

    def disorder(days: NDArray[np.float64]) -> tuple[int, bool, float]:
        known = days[~np.isnan(days)]
        steps = np.diff(known)
        return -known.size, bool((steps < 0.0).any()), float(np.abs(steps).sum())

    days = min((np.array([_ordinal(date, order) for date in dates]) for order in ORDERS), key=disorder)
    return np.asarray(days - days[first])


def _ordinal(date: str, order: str) -> float:
    try:
        return datetime.strptime(re.sub("[./]", "-", date), order).toordinal()
    except ValueError:  # no such month or day
        return math.nan


def _coded(texts: pa.StringArray, codes: dict[str, int]) -> NDArray[np.int32]:
    """The code of every text; new texts get the next one."""
    coded = texts.dictionary_encode()
    numbers = [codes.setdefault(text, len(codes)) for text in coded.dictionary.to_pylist()]
    return np.array(numbers, dtype=np.int32)[np.asarray(coded.indices)]


def _integers(texts: pa.StringArray) -> NDArray[np.int64]:
    """Integers; −1 for an empty text."""
    return np.asarray(pc.if_else(pc.equal(texts, ""), "-1", texts).cast(pa.int64()))
