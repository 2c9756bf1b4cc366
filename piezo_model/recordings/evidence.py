"""What the values of columns tell about their roles, where names do not.

Time never falls. Of two signals the output lags the input, by hysteresis, creep or delay: drawn over the input
the loop runs counterclockwise for a positive gain and clockwise for a negative one, so that

    S = ½ Σ (a_k b_{k+1} − a_{k+1} b_k) · sign(cov(a, b))

is positive if b lags a. In data without a loop, the noisier signal is the sensor's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_model.recordings.table import ABSURD, Table
from solvers.arrays import Vector

ROWS = 1_000_000
"""Rows from the start that are looked at."""
LEAST_ROWS = 16
LEAST_LOOP = 0.004
"""Smallest area of a loop, as a share of the product of both ranges, whose sense counts."""
LEAST_NOISE_RATIO = 4.0
BINS, MOST_LEVELS, TOO_FEW, ELSEWHERE = 100, 20, 4, 0.01
"""Bins of the drive's range, the most of them that are levels, the most that determine no hysteresis, and the largest
share of the samples beside these, of a drive that says little of what lies between its levels."""
REASONS = LAGS, NOISIER = "because the output lags the input", "because the output is the noisier one"
"""Reasons for roles that values tell."""


@dataclass(frozen=True)
class Profile:
    """One column, values apart that are missing or absurd."""

    low: float
    high: float
    rises: bool
    """Never falls, and is not constant."""
    counts: bool
    """Increases by one in every row: an index."""
    uniform: bool
    """Increases nearly evenly."""


def profiles(table: Table, columns: Sequence[int]) -> dict[int, Profile]:
    """Profiles of columns by position."""
    return (
        {k: _profile(values) for k, values in zip(columns, table.read(columns, slice(ROWS)), strict=True)}
        if columns
        else {}
    )


def _profile(values: Vector) -> Profile:
    known = values[np.abs(values) < ABSURD]
    if known.size < 2:
        known = np.zeros(2)
    steps = np.diff(known)
    least, most = float(steps.min()), float(steps.max())
    return Profile(
        float(known.min()),
        float(known.max()),
        rises=least >= 0.0 < most,
        counts=least == most == 1.0,
        uniform=most - least <= 0.5 * float(steps.mean()),
    )


def level_count(x: Vector) -> int:
    """Number of levels of a drive (N,) with MOST_LEVELS or fewer; 0 for others.

    Examples
    --------
    >>> level_count(np.repeat([0.0, 1.0, 0.0, 1.0], 500)), level_count(np.linspace(0.0, 1.0, 2000))
    (2, 0)
    """
    counts = np.sort(np.histogram(x, BINS)[0])[::-1]
    levels = 1 + int(np.searchsorted(np.cumsum(counts), (1.0 - ELSEWHERE) * x.size))
    return levels if levels <= MOST_LEVELS else 0


def input_first(table: Table, pair: Sequence[int]) -> tuple[Sequence[int], str]:
    """Positions of input and output among two columns, and the reason; empty if the values do not tell."""
    rows = np.stack(table.read(pair, slice(ROWS)))
    rows = rows[:, (np.abs(rows) < ABSURD).all(axis=0)]
    if rows.shape[1] < LEAST_ROWS:
        return (), ""
    distinct = [np.unique(row).size for row in rows]
    if min(distinct) <= TOO_FEW < max(distinct):
        return (pair if distinct[0] <= TOO_FEW else pair[::-1]), f"as the one of {min(distinct)} levels"
    a, b = window = rows - rows[:, :1]
    area, ranges = 0.5 * float(np.sum(a[:-1] * b[1:] - a[1:] * b[:-1])), np.ptp(window, axis=1)
    if not np.all(ranges > 0):
        return (), ""
    variation, bends = (np.abs(np.diff(window, order, axis=1)).sum(axis=1) for order in (1, 2))
    loops = max(1.0, float(np.min(variation / (2 * ranges))))
    lag = area * np.sign(np.cov(a, b)[0, 1]) / (loops * ranges[0] * ranges[1])
    if abs(lag) > LEAST_LOOP:
        return (pair if lag > 0 else pair[::-1]), LAGS
    noise = bends / ranges
    if noise.max() > LEAST_NOISE_RATIO * noise.min():
        return (pair if noise[0] < noise[1] else pair[::-1]), NOISIER
    return (), ""
