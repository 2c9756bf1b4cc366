"""What the values of columns say about their roles where the names say nothing.

Time never falls. Of two signals the output lags the input, be it by hysteresis, creep or delay: drawn over the input
the loop is run through counterclockwise where the gain is positive, clockwise where it is negative, so that

    S = ½ Σ (a_k b_{k+1} − a_{k+1} b_k) · sign(cov(a, b))

is positive if b lags a. Data without a loop have a noisier side, and that is the sensor's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_model.recordings.chunks import ABSURD, rechunk
from piezo_model.recordings.tables import Table
from solvers.arrays import Matrix

LOOK = 1_000_000
"""Rows from the start that tell input from output."""
LEAST_LOOP = 0.004
"""Area of a loop, as a share of the product of both ranges, from which its sense tells input from output."""
LEAST_NOISE_RATIO = 4.0
REASONS = LAGS, NOISIER = "because the output lags the input", "because the output is the noisier one"
"""Why values tell input from output."""


@dataclass(frozen=True)
class Profile:
    """One column over all rows; comparisons with NaN are false."""

    low: float
    high: float
    rises: bool
    """Never falls, and is not constant."""
    counts: bool
    """Goes up by one from row to row: an index."""
    uniform: bool
    """Goes up by nearly the same from row to row."""


def profiles(table: Table, at: Sequence[int]) -> dict[int, Profile]:
    """Profiles of columns by position, in one pass."""
    if not at:
        return {}
    low, high = np.full(len(at), np.inf), np.full(len(at), -np.inf)
    least, most, total, rows = low.copy(), high.copy(), np.zeros(len(at)), 0
    last: Matrix = np.empty((len(at), 0))
    for piece in map(_sane, table.pieces(at)):
        low, high = np.fmin(low, np.fmin.reduce(piece, axis=1)), np.fmax(high, np.fmax.reduce(piece, axis=1))
        steps = np.diff(np.concatenate([last, piece], axis=1), axis=1)
        if steps.size:
            least, most = np.minimum(least, steps.min(axis=1)), np.maximum(most, steps.max(axis=1))
            total, rows = total + steps.sum(axis=1), rows + steps.shape[1]
        last = piece[:, -1:].copy()
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
    """Which of two columns is the input and which the output, and why; nothing where the values do not tell."""
    rows = _sane(next(rechunk(table.pieces(pair), LOOK), np.empty((2, 0))))
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


def _sane(piece: Matrix) -> Matrix:
    """NaN in place of absurdly large values, which would overflow in sums."""
    return np.where(np.abs(piece) < ABSURD, piece, np.nan)
