"""The sampling period behind a column of times.

Uniform sampling means t_k = t_0 + k T. Printed times are rounded by up to half the last digit r (125 µs printed with
three digits reads 0.000, 0.000, …), so two times s samples apart may differ from s T by r. If r divides T, the rounding
does not show, and r = 0. With a tolerance τ on every interval and an error e of the estimate of T, times pass if

    |t_{k+s} − t_k − s T| ≤ r + s (τ T + e)

for s = 1, and also for a stride s of at least two digits if r hides single intervals. Since r may also hide that the
rate changes, one half of the times is compared with the other: there s is half their number, and instead of r stands
4 r √s, as far as a jitter of one digit accumulates.

T is first estimated by the median of (t_{k+h} − t_k) / h, which is robust to a single gap, and finally by the mean over
the recording, as the shortest decimal within the rounding. Times may be rounded to decimals, to significant digits, or
to single precision.
"""

import math

import numpy as np

from piezo_model.recordings.rows import WINDOW, Rows
from piezo_model.recordings.table import check_sample_time
from solvers.arrays import Vector

SAME_RATE, MOST_CHANGE = 16, 1.05
"""Intervals from which the sampling rates at start and end are estimated; largest ratio of equal rates."""
WALK = 4.0
"""Standard deviations of a random walk of digits, beyond which it is another rate."""
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


def sampling(rows: Rows, tolerance: float, even: bool = True) -> float:
    """Sampling period in seconds of the times of at least two rows, none of them missing.

    Parameters
    ----------
    rows : Rows
    tolerance : float
        Largest deviation of an interval, relative to the period.
    even : bool
        Whether gaps and jitter are refused.

    Raises
    ------
    RecordingError
        Times that run backwards or stand still, or with ``even`` times with gaps or jitter.
    """
    times, head, n, duration = rows.times, rows.times[:WINDOW], rows.length, float(rows.times[-1] - rows.times[0])
    for at in np.flatnonzero(times[1:] < times[:-1])[:1] + 1:
        raise rows.refusal(
            f"runs backwards in {rows.where(int(at))}: {rows.seconds(times[at])} follows "
            f"{rows.seconds(times[at - 1])}; sort the rows by time"
        )
    mean, (digit, exact) = duration / (n - 1), printed_digit(head)
    period = float(head[-1] - head[0]) / (head.size - 1)
    shows = _rounding_shows(np.diff(head), tolerance * period, period / digit)
    resolution = digit if shows else exact
    if period == 0.0 or resolution > tolerance * duration:
        raise rows.refusal(
            f"stands still from {rows.where(0)} on, at {rows.seconds(times[0])}, or moves by few of its last digits; "
            "--time none and --sample-time state the period"
        )
    # long enough for the rounding to be negligible, short enough for one gap to affect few of the differences
    reach = max(1, min(math.ceil(4 * resolution / (tolerance * period)), head.size // 8))
    error = resolution / (head.size - 1)
    if reach * period >= 2 * resolution:
        error = resolution / reach
        period = float(np.median(head[reach:] - head[:-reach])) / reach or period  # 0 if most are equal
    strides = [1, min(WINDOW, 2 * math.ceil(resolution / period))] if resolution > period / 2 else [1]
    if n > WINDOW:
        later, exact = printed_digit(times[-WINDOW:])  # significant digits are fewer at larger times
        resolution = max(resolution, later if shows or later > digit else exact)
    hidden = [*((stride, resolution) for stride in strides), (n // 2, WALK * resolution * math.sqrt(n // 2))]
    for stride, least in hidden if even else ():
        allowed = least + stride * (tolerance * period + error)
        excess = times[stride:] - times[:-stride] - stride * period
        for at in np.flatnonzero(np.abs(excess) > allowed)[:1]:
            rates = [float(np.median(np.diff(window))) for window in (times[: SAME_RATE + 1], times[-SAME_RATE - 1 :])]
            sentence = (
                f"has two sampling rates: one sample every {rows.seconds(rates[0])} at its start and one every "
                f"{rows.seconds(rates[1])} at its end"
                if max(rates) > MOST_CHANGE * min(rates) > 0.0
                else f"is not sampled uniformly: {rows.seconds(times[at + stride] - times[at])} from "
                f"{rows.where(int(at))} to {rows.where(int(at) + stride)}, where {rows.seconds(stride * period)} is "
                f"expected within {rows.seconds(allowed)}"
            )
            finest = min([period, *filter(None, rates)]) * rows.unit
            raise rows.refusal(f"{sentence}; --resample {finest:.6g} interpolates to an even clock")
    check_sample_time(f"{rows.path}: {rows.time_label}: ", mean * rows.unit)
    return _shortest(mean * rows.unit, (resolution / (n - 1) + 1e-9 * mean) * rows.unit)


def _rounding_shows(steps: Vector, tolerated: float, digits: float) -> bool:
    """True if the last digit explains unequal intervals: not if it divides the period, which is so many digits long,
    and nearly all intervals are equal."""
    unequal = np.abs(steps - np.median(steps)) > tolerated
    divides = abs(digits - round(digits)) <= min(1.5 / steps.size, 0.15)
    return round(digits) == 0 or not divides or int(np.count_nonzero(unequal)) > max(3, 0.05 * steps.size)


def _shortest(value: float, uncertainty: float) -> float:
    """The number with the fewest significant digits within the uncertainty of a value."""
    shorter = (float(f"{value:.{digits}e}") for digits in range(17))
    return next((number for number in shorter if abs(number - value) <= uncertainty), value)
