"""Roles of columns by their values, for names that do not tell.

Time never falls. Of two signals the output lags the input, by hysteresis, creep or delay: drawn over the input
the loop runs counterclockwise for a positive gain and clockwise for a negative one, so that

    S = ½ Σ (a_k b_{k+1} − a_{k+1} b_k) · sign(cov(a, b))

is positive if b lags a. In data without a loop, the noisier signal is the sensor's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_model.recordings.chunks import ABSURD, rechunk
from piezo_model.recordings.tables import Table
from solvers.arrays import Matrix

LOOP_ROWS = 1_000_000
"""Rows from the start that distinguish input and output."""
LEAST_LOOP = 0.004
"""Smallest area of a loop, as a share of the product of both ranges, whose sense counts."""
LEAST_NOISE_RATIO = 4.0
REASONS = LAGS, NOISIER = "because the output lags the input", "because the output is the noisier one"
"""Reasons for roles that values tell."""


@dataclass(frozen=True)
class Profile:
    """One column over all rows; comparisons with NaN are false."""

    low: float
    high: float
    rises: bool
    """Never falls, and is not constant."""
    counts: bool
    """Increases by one in every row: an index."""
    uniform: bool
    """Increases nearly evenly."""


def profiles(table: Table, at: Sequence[int]) -> dict[int, Profile]:
    """Profiles of columns by position, in one pass."""
    if not at:
        return {}
    low, high = np.full(len(at), np.inf), np.full(len(at), -np.inf)
    least, most, total, rows = low.copy(), high.copy(), np.zeros(len(at)), 0
    last: Matrix = np.empty((len(at), 0))
    for chunk in map(_without_absurd, table.chunks(at)):
        low, high = np.fmin(low, np.fmin.reduce(chunk, axis=1)), np.fmax(high, np.fmax.reduce(chunk, axis=1))
        steps = np.diff(np.concatenate([last, chunk], axis=1), axis=1)
        if steps.size:
            least, most = np.minimum(least, steps.min(axis=1)), np.maximum(most, steps.max(axis=1))
            total, rows = total + steps.sum(axis=1), rows + steps.shape[1]
        last = chunk[:, -1:].copy()
    mean = total / max(rows, 1)
    return {
        k: Profile(
            float(low[i]),
            float(high[i]),
            bool(least[i] >= 0 and most[i] > 0),
            bool(least[i] == most[i] == 1),
            bool(most[i] - least[i] <= 0.5 * mean[i]),
        )
        for i, k in enumerate(at)
    }


def input_first(table: Table, pair: tuple[int, int]) -> tuple[Sequence[int], str]:
    """Positions of input and output among two columns, and the reason; empty if the values do not tell."""
    rows = _without_absurd(next(rechunk(table.chunks(pair), LOOP_ROWS), np.empty((2, 0))))
    if rows.shape[1] < 16:
        return (), ""
    a, b = window = rows - rows[:, :1]
    area, ranges = 0.5 * float(np.sum(a[:-1] * b[1:] - a[1:] * b[:-1])), np.ptp(window, axis=1)
    variation, bends = (np.abs(np.diff(window, order, axis=1)).sum(axis=1) for order in (1, 2))
    if not np.all(ranges > 0) or not np.all(np.isfinite(bends)):
        return (), ""
    loops = max(1.0, float(np.min(variation / (2 * ranges))))
    lag = area * np.sign(np.cov(a, b)[0, 1]) / (loops * ranges[0] * ranges[1])
    if abs(lag) > LEAST_LOOP:
        return (pair if lag > 0 else pair[::-1]), LAGS
    noise = bends / ranges
    if noise.max() > LEAST_NOISE_RATIO * noise.min():
        return (pair if noise[0] < noise[1] else pair[::-1]), NOISIER
    return (), ""


def _without_absurd(chunk: Matrix) -> Matrix:
    """The chunk with NaN for values too large to be summed."""
    return np.where(np.abs(chunk) < ABSURD, chunk, np.nan)
