"""References typical of machines, with the same arguments as the signals of `piezo_model.signals`."""

import math

import numpy as np
from numpy.typing import ArrayLike

from piezo_model.signals import scaled, smoothed, times
from solvers.arrays import Vector


def set_point_steps(
    *,
    duration_s: float,
    sample_time: float,
    low: float,
    high: float,
    seed: int,
    mean_hold_s: float = 0.4,
    step_s: float = 0.02,
) -> Vector:
    """Random levels between the limits, each held for an exponentially distributed time."""
    t, random = times(duration_s, sample_time, low, high), np.random.default_rng(seed)
    ends = np.cumsum(random.exponential(mean_hold_s, int(4.0 * duration_s / mean_hold_s) + 50))
    levels = random.uniform(low, high, ends.size)
    return np.clip(smoothed(levels[np.searchsorted(ends[:-1], t)], step_s, sample_time), low, high)


def raster_scan(
    *,
    duration_s: float,
    sample_time: float,
    low: float,
    high: float,
    line_rate_Hz: float = 10.0,
    fast_share: float = 0.6,
) -> Vector:
    """One axis of a raster scan: a triangle over a share of the range, whose base rises by a step after each line."""
    t = times(duration_s, sample_time, low, high)
    line = line_rate_Hz * t
    last_line = max(1.0, math.ceil(line_rate_Hz * duration_s) - 1.0)
    base, triangle = np.minimum(np.floor(line) / last_line, 1.0), 1.0 - np.abs(1.0 - 2.0 * (line % 1.0))
    return scaled(fast_share * triangle + (1.0 - fast_share) * base, low, high)


def changing_amplitude(
    *,
    duration_s: float,
    sample_time: float,
    low: float,
    high: float,
    seed: int,
    piece_s: float = 10.0,
    frequency_Hz: float = 1.0,
    smallest_share: float = 0.15,
) -> Vector:
    """Sine whose amplitude (at least ``smallest_share`` of the largest) and centre are drawn anew for every
    ``piece_s``."""
    t, random = times(duration_s, sample_time, low, high), np.random.default_rng(seed)
    piece = (t / piece_s).astype(int)
    amplitude = random.uniform(smallest_share, 1.0, piece[-1] + 1)
    centre = random.uniform(-1.0, 1.0, piece[-1] + 1) * (1.0 - amplitude)
    blend = [smoothed(values[piece], min(0.2, 0.5 * piece_s), sample_time) for values in (amplitude, centre)]
    return scaled(0.5 + 0.5 * (blend[1] + blend[0] * np.sin(2.0 * np.pi * frequency_Hz * t)), low, high)


def from_samples(
    values: ArrayLike, *, duration_s: float, sample_time: float, low: float, high: float, period_s: float = 10.0
) -> Vector:
    """Periodic linear interpolation of samples (M,), not all equal, scaled to the period and the limits.

    Examples
    --------
    >>> from_samples([3.0, 5.0], duration_s=4.0, sample_time=0.5, low=0.0, high=1.0, period_s=2.0).tolist()
    [0.0, 0.5, 1.0, 0.5, 0.0, 0.5, 1.0, 0.5]
    """
    t, v = times(duration_s, sample_time, low, high), np.asarray(values, dtype=np.float64)
    shares = (v - v.min()) / np.ptp(v)
    return scaled(
        np.interp(t / period_s % 1.0 * v.size, np.arange(v.size + 1), np.append(shares, shares[0])), low, high
    )
