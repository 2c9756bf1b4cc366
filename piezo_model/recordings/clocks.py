"""Clocks as text (12:34:56.789, 2024-01-31T12:34:56.789Z, 31.01.2024 12:34:56,789) into seconds; pandas reads them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from solvers.arrays import Vector

if TYPE_CHECKING:
    import pandas as pd

_TIME = r"(?P<time>\d{1,2}:\d{2}(?::\d{2})?(?:[.,:]\d+)?)\s*(?P<half>[AaPp][Mm])?"
_DATE = r"(?:(?P<date>\d{4}[-./]\d{1,2}[-./]\d{1,2}|\d{1,2}[-./]\d{1,2}[-./]\d{4})(?:[T_\s]+|\s*,\s*))?"
CLOCK = re.compile(rf"\s*{_DATE}{_TIME}\s*(?:Z|UTC|[+-]\d{{2}}:?\d{{2}})?\s*")
DOTTED_CLOCK = re.compile(r"\s*(\d{1,2})\.(\d{2})\.(\d{2})(\.\d+)?\s*")
DAY = 86400.0


class ClockError(ValueError):
    """A cell is no clock."""


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day, with or without a date."""
    return bool(CLOCK.fullmatch(cell) or DOTTED_CLOCK.fullmatch(cell))


class ClockReader:
    """Seconds since the first cell, over any number of pieces; a clock without date may pass midnight."""

    def __init__(self) -> None:
        """Start before the first cell."""
        self._origin: pd.Timestamp | None = None
        self._days, self._last = 0.0, -np.inf

    def seconds(self, cells: Sequence[str | None]) -> Vector:
        """Seconds of the next piece, NaN where a cell is missing.

        Raises
        ------
        ClockError
            A cell is no clock.
        """
        import pandas as pd

        written = pd.Series([_iso(cell) if cell else None for cell in cells], dtype=str)
        try:
            stamps = pd.DatetimeIndex(pd.to_datetime(written, format="ISO8601"))
        except ValueError as error:  # the 31st of February
            raise ClockError(str(error)) from None
        if self._origin is None:
            self._origin = stamps[0]
        passed = np.array((stamps - self._origin).total_seconds(), dtype=np.float64)
        nanoseconds = np.array(stamps.nanosecond, dtype=np.float64)  # total_seconds keeps microseconds only
        passed += np.where(np.isfinite(nanoseconds), nanoseconds, 0.0) * 1e-9
        before = np.concatenate([[self._last], passed[:-1]])
        midnights = np.cumsum(passed - before < -0.5 * DAY) if not any("-" in str(cell) or "/" in str(cell)
                                                                         for cell in cells[:1]) else 0.0
        self._last = float(passed[-1])
        result: Vector = passed + DAY * (self._days + midnights)
        self._days += float(np.max(midnights, initial=0.0))
        return result


def _iso(cell: str) -> str:
    dotted = DOTTED_CLOCK.fullmatch(cell)
    if dotted:
        return f"1970-01-01T{int(dotted[1]):02d}:{dotted[2]}:{dotted[3]}{dotted[4] or ''}"
    found = CLOCK.fullmatch(cell)
    if not found:
        raise ClockError(f"{cell!r} is no clock")
    clock, _, rest = found["time"].replace(",", ".").partition(".")
    parts = clock.split(":")
    if len(parts) == 4:  # 12:34:56:789
        rest = parts.pop()
    if len(parts) == 2:  # 34:56.789 are minutes and seconds; 12:34 without a fraction hours and minutes
        parts = ["0", *parts] if rest else [*parts, "0"]
    hours = int(parts[0])
    if found["half"]:
        hours = hours % 12 + (12 if found["half"].lower() == "pm" else 0)
    return f"{_iso_date(found['date'])}T{hours:02d}:{int(parts[1]):02d}:{int(parts[2]):02d}" + (f".{rest}" if rest else "")


def _iso_date(text: str | None) -> str:
    if text is None:
        return "1970-01-01"
    first, second, third = re.split(r"[-./]", text)
    if len(first) == 4:
        year, month, day = first, second, third
    elif "/" in text and int(first) <= 12:
        month, day, year = first, second, third
    else:
        day, month, year = first, second, third
    return f"{year}-{int(month):02d}-{int(day):02d}"
