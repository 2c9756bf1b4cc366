"""Is a recording what an identification may be fed with? One pass over its columns, in bounded memory.

Uniform sampling means t_k = t_0 + k T. Printed times carry a rounding of up to half the last digit r (125 µs printed
with three digits reads 0.000, 0.000, …), so that two of them, s samples apart, may miss s T by r without anything
being wrong; where r divides T it does not show, and r is 0. With a tolerance τ on every interval and an error e of the
estimate of T, a recording passes if for s = 1, and for a stride s of two or more digits r where r hides single
intervals,

    |t_{k+s} − t_k − s T| ≤ r + s (τ T + e).

T is first the median of t_{k+h} − t_k over h, which no single gap moves, and in the end the mean over the recording,
given as the shortest decimal that the rounding leaves possible.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from piezo_model.recordings.pieces import RecordingError, Vector, rechunk
from piezo_model.recordings.tables import Table

CHUNK = 65536
TIME_TOLERANCE = 0.01
"""Share of the sampling period by which an interval may differ from it."""
MOST_DECIMALS = 15

Where = Callable[[int], str]


@dataclass(frozen=True)
class Scan:
    """What one pass over a table found."""

    sample_time: float
    """Sampling period in seconds."""
    time_resolution: float
    """Rounding that shows in the times, in seconds."""
    length: int
    ranges: tuple[tuple[float, float], ...]
    """Smallest and largest value of every signal."""


def scan(table: Table, time: str, signals: Sequence[str], seconds: float, tolerance: float = TIME_TOLERANCE) -> Scan:
    """Check a time column and signal columns in one pass.

    Parameters
    ----------
    table : Table
        Opened table.
    time, signals : str, sequence of str
        Column names.
    seconds : float
        Seconds in one unit of the time column.
    tolerance : float
        Allowed deviation of an interval, as a share of the sampling period.

    Raises
    ------
    RecordingError
        Missing, NaN or infinite values, times that run backwards, stand still, leap or jitter, fewer than two rows.
    """
    if not 0 < tolerance < 0.5:
        raise RecordingError(f"the time tolerance is a share of the sampling period between 0 and 0.5, not {tolerance}")
    values = [ValueCheck(f"{table.path}: column {name!r}", table.where) for name in (time, *signals)]
    clock = ClockCheck(f"{table.path}: time column {time!r}", table.where, seconds, tolerance)
    for piece in rechunk(table.pieces([time, *signals]), CHUNK):
        for check, column in zip(values, piece, strict=True):
            check.update(column)
        if not values[0].bad:
            clock.update(piece[0])
    for check in values:
        check.finish()
    return Scan(clock.sample_time(), clock.resolution * seconds, values[0].count,
                tuple((check.low, check.high) for check in values[1:]))


class ValueCheck:
    """Finite values and their range, over any number of pieces.

    Parameters
    ----------
    label : str
        How the sentence of an error starts.
    where : callable
        Names a row counted from 0.
    """

    def __init__(self, label: str, where: Where) -> None:
        """Start before the first sample."""
        self.label, self.where = label, where
        self.count = self.bad = 0
        self.low, self.high = math.inf, -math.inf
        self._first_bad, self._first_value = 0, 0.0

    def update(self, values: Vector) -> None:
        """Take the next piece."""
        finite = np.isfinite(values)
        if not finite.all():
            if not self.bad:
                at = int(np.argmin(finite))
                self._first_bad, self._first_value = self.count + at, float(values[at])
            self.bad += int(values.size - np.count_nonzero(finite))
            values = values[finite]
        self.count += finite.size
        if values.size:
            self.low, self.high = min(self.low, float(values.min())), max(self.high, float(values.max()))

    def finish(self) -> None:
        """Refuse what is not finite."""
        if self.bad:
            kind = "missing (or NaN)" if math.isnan(self._first_value) else "infinite"
            many = f"; in all {self.bad} of {self.count} values are not finite" if self.bad > 1 else ""
            raise RecordingError(f"{self.label} is {kind} in {self.where(self._first_bad)}{many}")


class ClockCheck:
    """Uniform sampling, over any number of pieces, the first of which settles the sampling period to look for.

    Parameters
    ----------
    label, where
        As for :class:`ValueCheck`.
    seconds : float
        Seconds in one unit of the times.
    tolerance : float
        Allowed deviation of an interval, as a share of the period.
    """

    def __init__(self, label: str, where: Where, seconds: float, tolerance: float) -> None:
        """Start before the first sample."""
        self.label, self.where, self.seconds, self.tolerance = label, where, seconds, tolerance
        self.count = 0
        self.resolution = 0.0
        """Rounding that shows in the times so far, in units of the column."""
        self._first = self._last = 0.0
        self._tail: Vector = np.empty(0)
        self._period = self._period_error = self._float = 0.0
        self._strides = [1]

    def update(self, times: Vector) -> None:
        """Take the next piece of finite times, shape (rows,)."""
        start = self.count - self._tail.size
        window = np.concatenate([self._tail, times])
        self._refuse_backwards(window, start)
        if not self.count:
            self._first = float(times[0])
            if times.size > 1:
                self._settle(times)
        self.resolution = max(self.resolution, self._float * float(np.abs(times).max()))
        self.count += times.size
        self._last = float(times[-1])
        for stride in self._strides:
            self._refuse_irregular(window, start, stride)
        self._tail = window[-self._strides[-1]:].copy()

    def sample_time(self) -> float:
        """Sampling period in seconds, after the last piece."""
        if self.count < 2:
            raise RecordingError(f"{self.label} has {self.count} data row{'' if self.count == 1 else 's'}, "
                                 "and a sampling period needs two")
        period = (self._last - self._first) / (self.count - 1)
        return _shortest(period * self.seconds, (self.resolution / (self.count - 1) + 1e-9 * period) * self.seconds)

    def _settle(self, times: Vector) -> None:
        n = times.size
        mean = float(times[-1] - times[0]) / (n - 1)
        if mean == 0:
            raise RecordingError(f"{self.label} stands still from {self.where(0)} on, at {self._seconds(times[0])}")
        digit, self._float = _printed_digit(times)
        if not self._rounding_shows(times, mean, digit):
            digit = self._float * float(np.abs(times).max())
        self.resolution = digit
        # Far enough apart for the rounding to vanish, near enough for one gap to touch few of the differences.
        reach = max(1, min(math.ceil(4 * digit / (self.tolerance * mean)), n // 8))
        if reach * mean >= 2 * digit:
            self._period, self._period_error = float(np.median(times[reach:] - times[:-reach])) / reach, digit / reach
        else:
            self._period, self._period_error = mean, digit / (n - 1)
        if self._period <= 0:  # most of the times stand still
            self._period = mean
        if digit > self._period / 2:
            self._strides.append(min(CHUNK, 2 * math.ceil(digit / self._period)))

    def _rounding_shows(self, times: Vector, mean: float, digit: float) -> bool:
        """Whether the last digit explains unequal intervals: not if it divides the period and nearly all are equal."""
        steps, digits = np.diff(times), mean / digit
        odd = np.abs(steps - np.median(steps)) > self.tolerance * mean
        drifts = abs(digits - round(digits)) > min(1.5 / steps.size, 0.15)
        return round(digits) == 0 or drifts or int(np.count_nonzero(odd)) > max(3, 0.05 * steps.size)

    def _refuse_backwards(self, window: Vector, start: int) -> None:
        back = np.flatnonzero(np.diff(window) < 0)
        if back.size:
            at = int(back[0]) + 1
            raise RecordingError(f"{self.label} runs backwards in {self.where(start + at)}: "
                                 f"{self._seconds(window[at])} follows {self._seconds(window[at - 1])}")

    def _refuse_irregular(self, window: Vector, start: int, stride: int) -> None:
        period, steps = self._period, window[stride:] - window[:-stride]
        excess = steps - stride * period
        allowed = self.resolution + stride * (self.tolerance * period + self._period_error)
        wrong = np.flatnonzero(np.abs(excess) > allowed)
        if not wrong.size:
            return
        at = int(wrong[0])
        place = self.where(start + at + stride)
        if steps[at] == 0:
            sentence = f"stands still in {place}, at {self._seconds(window[at])}"
        elif excess[at] > period / 2:
            missing = max(1, round(float(excess[at]) / period))
            sentence = (f"has a gap of {self._seconds(steps[at])} before {place}: about {missing} "
                        f"sample{'s' if missing > 1 else ''} missing at one every {self._seconds(period)}")
        else:
            sentence = (f"is not sampled uniformly: {self._seconds(steps[at])} from {self.where(start + at)} to "
                        f"{place}, where {self._seconds(stride * period)} is expected within {self._seconds(allowed)}")
        raise RecordingError(f"{self.label} {sentence}")

    def _seconds(self, value: float) -> str:
        return f"{value * self.seconds:.9g} s"


def _printed_digit(times: Vector) -> tuple[float, float]:
    """Last decimal digit that all times are printed with, and the relative rounding of their type."""
    single = bool((times.astype(np.float32).astype(np.float64) == times).all())
    relative = float(np.finfo(np.float32 if single else np.float64).eps)
    floor = relative * float(np.abs(times).max())
    for decimals in range(MOST_DECIMALS + 1):
        if 10.0**-decimals <= 16 * floor:  # every number would look rounded to it
            break
        if (np.abs(np.round(times, decimals) - times) <= 4 * floor).all():
            return 10.0**-decimals, relative
    return floor, relative


def _shortest(value: float, uncertainty: float) -> float:
    """Number of the fewest significant digits within the uncertainty of a value."""
    for digits in range(17):
        short = float(f"{value:.{digits}e}")
        if abs(short - value) <= uncertainty:
            return short
    return value
