"""Latencies as histograms with high dynamic range: small, mergeable, and right to 0.1 % from nanoseconds to an hour.

Raw nanoseconds are kept beside them; a histogram is what travels with a row, what several processes are merged by and
what a curve of latency against percentile is drawn from.

*Corrected* recording is for times taken back to back. A call of length t > T keeps waiting whatever was due in the
meantime, at T, 2 T, …, and a loop that has no schedule never asks those. So t stands for t, t − T, t − 2 T, … down to
the first that is not above T. On a schedule the response times have it all already, and correcting them would count it
twice.

Source: G. Tene, "How NOT to measure latency" (2013) and HdrHistogram, whose Python package this is.
"""

from collections.abc import Iterable

import numpy as np
from hdrh.histogram import HdrHistogram
from numpy.typing import ArrayLike, NDArray

LOWEST_NS, HIGHEST_NS, DIGITS = 1, 3_600_000_000_000, 3


def recorded(nanoseconds: ArrayLike, period_ns: int | None = None) -> str:
    """Record times, shape (N,), corrected for a period if one is given, and return the histogram as text.

    ValueError where a time is negative or above an hour.

    Examples
    --------
    >>> text = recorded([100, 100, 300], period_ns=125)
    >>> total(text), total(recorded([100, 100, 300]))
    (5, 3)
    """
    times = np.asarray(nanoseconds, dtype=np.int64)
    if times.size and not (times.min() >= 0 and times.max() <= HIGHEST_NS):
        raise ValueError(f"a latency of {times.min()} to {times.max()} ns is not between 0 and one hour")
    histogram = HdrHistogram(LOWEST_NS, HIGHEST_NS, DIGITS)
    for value, count in zip(*(part.tolist() for part in np.unique(times, return_counts=True)), strict=True):
        if period_ns is None:
            histogram.record_value(value, count)
        else:
            histogram.record_corrected_value(value, period_ns, count)
    return histogram.encode().decode("ascii")


def merged(texts: Iterable[str]) -> str:
    """One histogram of all that several have recorded."""
    histogram = HdrHistogram(LOWEST_NS, HIGHEST_NS, DIGITS)
    for text in texts:
        histogram.decode_and_add(text)
    return histogram.encode().decode("ascii")


def total(text: str) -> int:
    """How many times a histogram holds."""
    return HdrHistogram.decode(text).get_total_count()


def quantiles(text: str, shares: ArrayLike) -> NDArray[np.float64]:
    """Nanoseconds below which these shares of the times lie, each right to 0.1 %; NaN where nothing was recorded."""
    histogram, percents = HdrHistogram.decode(text), 100.0 * np.atleast_1d(np.asarray(shares, dtype=np.float64))
    if not histogram.get_total_count():
        return np.full(percents.shape, np.nan)
    found = histogram.get_percentile_to_value_dict(percents.tolist())
    return np.array([found[percent] for percent in percents.tolist()], dtype=np.float64)
