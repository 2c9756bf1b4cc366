"""The sampling period behind a column of times.

Uniform sampling means t_k = t_0 + k T. Printed times are rounded by up to half the last digit r (125 µs printed with
three digits reads 0.000, 0.000, …), so two times s samples apart may differ from s T by r. If r divides T, the rounding
does not show, and r = 0. With a tolerance τ on every interval and an error e of the estimate of T, times pass if

    |t_{k+s} − t_k − s T| ≤ r + s (τ T + e)

for s = 1, and also for a stride s of at least two digits r if r hides single intervals.

T is first estimated by the median of (t_{k+h} − t_k) / h, which is robust to a single gap, and finally by the mean over
the recording, as the shortest decimal within the rounding. Times may be rounded to decimals, to significant digits, or
to single precision.
"""

import math
from dataclasses import dataclass

import numpy as np

from piezo_model.recordings.rows import Rows
from piezo_model.recordings.table import RecordingError, check_sample_time
from solvers.arrays import Vector

WINDOW = 65536
"""Times at the start, and at the end, from which their rounding is determined."""
SAME_RATE, MOST_CHANGE = 16, 1.05
"""Intervals from which the sampling rates at start and end are estimated; largest ratio of equal rates."""
MOST_DECIMALS = 15
FEW = 8
"""Fewest times that determine a digit."""
SINGLE_GRID = 0.1
"""Largest distance from the grid of single precision, relative to its spacing."""


def printed_digit(times: Vector) -> tuple[float, float]:
    """Last decimal digit of printed times, and their floating-point rounding; both are the latter if no decimals show.

    With significant digits, as of ``%g``, the largest times have the fewest decimals, so only times above the last
    power of ten are used.
    """
    size = np.abs(times)
    exact = float(size.max()) * float(np.finfo(np.float32 if _single(times) else np.float64).eps)
    large = times[size >= 10.0 ** math.floor(math.log10(float(size.max()) or 1.0))]
    printed = large if large.size >= FEW else times
    for decimals in range(MOST_DECIMALS + 1):
        digit = 10.0**-decimals
        if digit <= 16 * exact:  # every number would seem to be rounded to it
            break
        if (np.abs(np.round(printed, decimals) - printed) <= 4 * exact).all():
            return digit, exact
    return exact, exact


def _single(times: Vector) -> bool:
    """True if times have single precision, even if printed in decimals: they lie far closer to its grid than by
    chance."""
    nonzero = times[times != 0.0]
    grid = np.float32(nonzero)
    near = np.abs(grid - nonzero) < SINGLE_GRID * np.spacing(np.abs(grid))
    return bool(near.all()) and np.unique(grid).size == np.unique(nonzero).size


@dataclass(frozen=True)
class Clock:
    """The times of at least two rows, none of them missing."""

    rows: Rows
    seconds: float
    """Unit of the times."""
    tolerance: float
    """Largest deviation of an interval, relative to the period."""

    def sampling(self, even: bool = True) -> float:
        """Sampling period in seconds.

        Raises
        ------
        RecordingError
            Times that run backwards or stand still, or with ``even`` times with gaps or jitter.
        """
        assert self.rows.times is not None
        times, n = self.rows.times, self.rows.length
        for at in np.flatnonzero(times[1:] < times[:-1])[:1] + 1:
            before, after = map(self._seconds, times[at - 1 : at + 1])
            raise self._refusal(f"runs backwards in {self.rows.where(int(at))}: {after} follows {before}")
        mean, (digit, exact) = float(times[-1] - times[0]) / (n - 1), printed_digit(times[:WINDOW])
        head = times[:WINDOW]
        period = float(head[-1] - head[0]) / (head.size - 1)
        if period == 0.0:
            raise self._refusal(f"stands still from {self.rows.where(0)} on, at {self._seconds(times[0])}")
        shows = self._rounding_shows(np.diff(head), period, digit)
        resolution = digit if shows else exact
        # long enough for the rounding to be negligible, short enough for one gap to affect few of the differences
        reach = max(1, min(math.ceil(4 * resolution / (self.tolerance * period)), head.size // 8))
        error = resolution / (head.size - 1)
        if reach * period >= 2 * resolution:
            error = resolution / reach
            period = float(np.median(head[reach:] - head[:-reach])) / reach or period  # 0 if most are equal
        strides = [1, min(WINDOW, 2 * math.ceil(resolution / period))] if resolution > period / 2 else [1]
        if n > WINDOW:
            later, exact = printed_digit(times[-WINDOW:])  # significant digits are fewer at larger times
            resolution = max(resolution, later if shows or later > digit else exact)
        for stride in strides if even else ():
            self._refuse_uneven(times, stride, period, resolution + stride * (self.tolerance * period + error))
        check_sample_time(f"{self.rows.path}: {self.rows.time_label}: ", mean * self.seconds)
        uncertainty = (resolution / (n - 1) + 1e-9 * mean) * self.seconds
        return _shortest(mean * self.seconds, uncertainty)

    def _rounding_shows(self, steps: Vector, mean: float, digit: float) -> bool:
        """True if the last digit explains unequal intervals: not if it divides the period and nearly all are equal."""
        digits, unequal = mean / digit, np.abs(steps - np.median(steps)) > self.tolerance * mean
        divides = abs(digits - round(digits)) <= min(1.5 / steps.size, 0.15)
        return round(digits) == 0 or not divides or int(np.count_nonzero(unequal)) > max(3, 0.05 * steps.size)

    def _refuse_uneven(self, times: Vector, stride: int, period: float, allowed: float) -> None:
        excess = times[stride:] - times[:-stride]
        excess -= stride * period
        if not excess.size or max(float(excess.max()), -float(excess.min())) <= allowed:
            return
        at = int(np.argmax(np.abs(excess) > allowed))
        step, place = times[at + stride] - times[at], self.rows.where(at + stride)
        rates = [float(np.median(np.diff(window))) for window in (times[: SAME_RATE + 1], times[-SAME_RATE - 1 :])]
        if min(rates) > 0.0 and max(rates) > MOST_CHANGE * min(rates):
            sentence = (
                f"has two sampling rates: one sample every {self._seconds(rates[0])} at its start and one every "
                f"{self._seconds(rates[1])} at its end"
            )
        elif excess[at] > period / 2:
            missing = max(1, round(float(excess[at]) / period))
            sentence = (
                f"has a gap of {self._seconds(step)} before {place}: about {missing} "
                f"sample{'s' if missing > 1 else ''} missing at one every {self._seconds(period)}"
            )
        else:
            sentence = (
                f"is not sampled uniformly: {self._seconds(step)} from {self.rows.where(at)} to {place}, where "
                f"{self._seconds(stride * period)} is expected within {self._seconds(allowed)}"
            )
        finest = min([period, *filter(None, rates)]) * self.seconds
        raise self._refusal(f"{sentence}; --resample {finest:.6g} interpolates to an even clock")

    def _refusal(self, sentence: str) -> RecordingError:
        return RecordingError(f"{self.rows.path}: {self.rows.time_label} {sentence}")

    def _seconds(self, value: float) -> str:
        return f"{value * self.seconds:.9g} s"


def _shortest(value: float, uncertainty: float) -> float:
    """The number with the fewest significant digits within the uncertainty of a value."""
    shorter = (float(f"{value:.{digits}e}") for digits in range(17))
    return next((number for number in shorter if abs(number - value) <= uncertainty), value)
