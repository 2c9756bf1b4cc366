"""Checks that times are uniform, over any number of chunks and in bounded memory.

Uniform sampling means t_k = t_0 + k T. Printed times are rounded by up to half the last digit r (125 µs printed with
three digits reads 0.000, 0.000, …), so two times that are s samples apart may differ from s T by r; if r divides T the
rounding does not show, and r is 0. With a tolerance τ on every interval and an error e of the estimate of T, a
recording passes if

    |t_{k+s} − t_k − s T| ≤ r + s (τ T + e)

for s = 1, and also for a stride s of at least two digits r if r hides single intervals.

T is first estimated by the median of t_{k+h} − t_k over h, which is robust to a single gap, and finally by the mean
over the recording, given as the shortest decimal within the rounding.

Times may be rounded to decimals, to significant digits, or to single precision.
"""

import math
from collections.abc import Callable

import numpy as np

from piezo_model.recordings.chunks import RecordingError, check_sample_time
from solvers.arrays import Vector

CHUNK = 65536
TIME_TOLERANCE = 0.01
"""Largest deviation of an interval, as a share of the sampling period."""
SAME_RATE, LEAST_CHANGE = 16, 0.05
"""Fewest equal intervals in a row that make a sampling rate, and the smallest relative difference of another rate."""

MOST_DECIMALS = 15
FEW = 8
"""Fewest times whose decimals tell how they are printed."""
SINGLE_GRID = 0.1
"""Largest distance of a printed time from the nearest number in single precision, in steps of that grid; a random
number lies up to 0.5 away."""

RowName = Callable[[int], str]
"""Name of a row counted from 0."""


def printed_digit(times: Vector) -> tuple[float, float]:
    """Last decimal digit of printed times, and the rounding of their floating point alone; both are the latter if no
    decimals show.

    With significant digits, as of ``%g``, the largest times have the fewest decimals, so only those above the last
    power of ten are used.
    """
    size = np.abs(times)
    exact = float(size.max()) * float(np.finfo(np.float32 if _single(times) else np.float64).eps)
    large = times[size >= 10.0 ** math.floor(math.log10(float(size.max()) or 1.0))]
    printed = large if large.size >= FEW else times
    for decimals in range(MOST_DECIMALS + 1):
        digit = 10.0**-decimals
        if digit <= 16 * exact:  # every number would look rounded to it
            break
        if (np.abs(np.round(printed, decimals) - printed) <= 4 * exact).all():
            return digit, exact
    return exact, exact


def _single(times: Vector) -> bool:
    """Whether times have single precision, even if printed in decimals: they lie far closer to its grid than by
    chance."""
    nonzero = times[times != 0.0]
    grid = np.float32(nonzero)
    near = np.abs(grid - nonzero) < SINGLE_GRID * np.spacing(np.abs(grid))
    return bool(near.all()) and np.unique(grid).size == np.unique(nonzero).size


class ClockCheck:
    """Checks uniform sampling over any number of chunks; the first one determines the expected sampling period.

    Label and ``where`` are as for :class:`ValueCheck`; ``seconds`` is the unit of the times, and ``tolerance`` the
    largest deviation of an interval, as a share of the period. Without ``even`` any times that never fall pass.
    """

    def __init__(self, label: str, where: RowName, seconds: float, tolerance: float, even: bool = True) -> None:
        self.label, self.where, self.seconds, self.tolerance, self.even = label, where, seconds, tolerance, even
        self.count = 0
        self.resolution = 0.0
        """Visible rounding of the times so far, in units of the column."""
        self._first = self._last = 0.0
        self._tail: Vector = np.empty(0)
        self._period = self._period_error = 0.0
        self._digit, self._shows = 0.0, False
        self._strides = [1]

    def update(self, times: Vector) -> None:
        """Check the next chunk of finite times, shape (rows,)."""
        start = self.count - self._tail.size
        window = np.concatenate([self._tail, times])
        self._refuse_backwards(window, start)
        if not self.count:
            self._first = float(times[0])
            if times.size > 1:
                self._estimate_period(times)
        elif times.size >= FEW:
            digit, exact = printed_digit(times)
            self.resolution = max(self.resolution, digit if self._shows or digit > self._digit else exact)
        self.count += times.size
        self._last = float(times[-1])
        for stride in self._strides if self.even else ():
            self._refuse_irregular(window, start, stride)
        self._tail = window[-self._strides[-1] :].copy()

    @property
    def duration_s(self) -> float:
        """Seconds from the first time to the last so far."""
        return (self._last - self._first) * self.seconds

    def sample_time(self) -> float:
        """Sampling period in seconds, after the last chunk."""
        if self.count < 2:
            raise RecordingError(
                f"{self.label} has {self.count} data row{'' if self.count == 1 else 's'}, "
                "and a sampling period needs two"
            )
        period = (self._last - self._first) / (self.count - 1)
        check_sample_time(f"{self.label}: ", period * self.seconds)
        return _shortest(period * self.seconds, (self.resolution / (self.count - 1) + 1e-9 * period) * self.seconds)

    def _estimate_period(self, times: Vector) -> None:
        n = times.size
        mean = float(times[-1] - times[0]) / (n - 1)
        if mean == 0:
            raise RecordingError(f"{self.label} stands still from {self.where(0)} on, at {self._seconds(times[0])}")
        self._digit, exact = printed_digit(times)
        self._shows = self._rounding_shows(times, mean, self._digit)
        digit = self.resolution = self._digit if self._shows else exact
        # Long enough for the rounding to be negligible, short enough for one gap to affect few of the differences.
        reach = max(1, min(math.ceil(4 * digit / (self.tolerance * mean)), n // 8))
        if reach * mean >= 2 * digit:
            self._period, self._period_error = float(np.median(times[reach:] - times[:-reach])) / reach, digit / reach
        else:
            self._period, self._period_error = mean, digit / (n - 1)
        if self._period <= 0:  # most of the times are equal
            self._period = mean
        if digit > self._period / 2:
            self._strides.append(min(CHUNK, 2 * math.ceil(digit / self._period)))

    def _rounding_shows(self, times: Vector, mean: float, digit: float) -> bool:
        """Whether the last digit explains unequal intervals: not if it divides the period and nearly all are equal."""
        steps, digits = np.diff(times), mean / digit
        unequal = np.abs(steps - np.median(steps)) > self.tolerance * mean
        divides = abs(digits - round(digits)) <= min(1.5 / steps.size, 0.15)
        return round(digits) == 0 or not divides or int(np.count_nonzero(unequal)) > max(3, 0.05 * steps.size)

    def _refuse_backwards(self, window: Vector, start: int) -> None:
        back = window[1:] < window[:-1]
        if back.any():
            at = int(np.argmax(back)) + 1
            raise RecordingError(
                f"{self.label} runs backwards in {self.where(start + at)}: "
                f"{self._seconds(window[at])} follows {self._seconds(window[at - 1])}"
            )

    def _refuse_irregular(self, window: Vector, start: int, stride: int) -> None:
        period, steps = self._period, window[stride:] - window[:-stride]
        allowed = self.resolution + stride * (self.tolerance * period + self._period_error)
        if not steps.size or max(float(steps.max()) - stride * period, stride * period - float(steps.min())) <= allowed:
            return
        excess = steps - stride * period
        at = int(np.argmax(np.abs(excess) > allowed))
        place = self.where(start + at + stride)
        rates = two_rates(np.diff(window), self.tolerance)
        if rates is not None:
            sentence = (
                f"has two sampling rates: one sample every {self._seconds(rates[0])} up to "
                f"{self.where(start + rates[2])} and one every "
                f"{self._seconds(rates[1])} from there on"
            )
        elif steps[at] == 0:
            sentence = f"stands still in {place}, at {self._seconds(window[at])}"
        elif excess[at] > period / 2:
            missing = max(1, round(float(excess[at]) / period))
            sentence = (
                f"has a gap of {self._seconds(steps[at])} before {place}: about {missing} "
                f"sample{'s' if missing > 1 else ''} missing at one every {self._seconds(period)}"
            )
        else:
            sentence = (
                f"is not sampled uniformly: {self._seconds(steps[at])} from {self.where(start + at)} to "
                f"{place}, where {self._seconds(stride * period)} is expected within {self._seconds(allowed)}"
            )
        finest = (period if rates is None else min(rates[:2])) * self.seconds
        raise RecordingError(f"{self.label} {sentence}; --resample {finest:.6g} interpolates to an even clock")

    def _seconds(self, value: float) -> str:
        return f"{value * self.seconds:.9g} s"


def two_rates(steps: Vector, tolerance: float) -> tuple[float, float, int] | None:
    """The two periods of intervals that have one length before some index and another one after it, and that index;
    None for other intervals."""
    if steps.size < 2 * SAME_RATE:
        return None
    first = float(np.median(steps[:SAME_RATE]))
    changed = np.convolve(np.abs(steps - first) > max(tolerance, LEAST_CHANGE) * first, np.ones(SAME_RATE), "valid")
    if changed[0] or changed.max() < SAME_RATE:
        return None
    at = int(np.argmax(changed == SAME_RATE))
    second = float(np.median(steps[at : at + SAME_RATE]))
    agree = np.abs(steps[at : at + SAME_RATE] - second) <= max(tolerance, LEAST_CHANGE) * second
    return (first, second, at) if min(first, second) > 0.0 and agree.all() else None


def _shortest(value: float, uncertainty: float) -> float:
    """The number with the fewest significant digits within the uncertainty of a value."""
    shorter = (float(f"{value:.{digits}e}") for digits in range(17))
    return next((number for number in shorter if abs(number - value) <= uncertainty), value)
