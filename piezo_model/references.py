"""References of a machine at work, beside the test signals of `signals`: set points, changing amplitude, samples of any file.

The same rules hold, and the same arguments are common to all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from piezo_model.signals import positive, scaled, share_between, times
from solvers.arrays import Vector


def smoothed(steps: Vector, step_s: float, sample_time: float) -> Vector:
    """Let every step of a signal (N,) take ``step_s`` along a raised cosine; the first level has always been there."""
    window = np.hanning(round(step_s / sample_time) + 2)[1:-1]
    if window.size < 2:
        return steps
    held = np.concatenate([np.full(window.size - 1, steps[0]), steps])
    from scipy.signal import oaconvolve  # which takes most of a second

    smooth: Vector = oaconvolve(held, window / window.sum(), "valid")
    return np.clip(smooth, steps.min(), steps.max())


def set_point_steps(*, duration_s: float, sample_time: float, low: float, high: float, seed: int, mean_hold_s: float = 0.4,
                    step_s: float = 0.02) -> Vector:
    """Levels anywhere between the limits, each held for an exponentially distributed time.

    Parameters
    ----------
    seed : int
        Of levels and times.
    mean_hold_s, step_s : float
        Mean time between two steps, and what a step takes, s.
    """
    t = times(duration_s, sample_time, low, high)
    positive(mean_hold_s=mean_hold_s, step_s=step_s)
    random = np.random.default_rng(seed)
    ends = np.cumsum(random.exponential(mean_hold_s, int(4.0 * duration_s / mean_hold_s) + 50))
    levels = random.uniform(low, high, ends.size)
    return np.clip(smoothed(levels[np.searchsorted(ends[:-1], t)], step_s, sample_time), low, high)


def changing_amplitude(*, duration_s: float, sample_time: float, low: float, high: float, seed: int, piece_s: float = 10.0,
                       frequency_Hz: float = 1.0, smallest_share: float = 0.15) -> Vector:
    """Sine whose amplitude and centre are drawn anew for every piece of the time.

    Parameters
    ----------
    seed : int
        Of the pieces.
    piece_s : float
        Length of a piece, s.
    frequency_Hz : float
        Of the sine, below half the sampling rate.
    smallest_share : float
        Smallest amplitude over the largest possible one, 0 to 1.
    """
    t = times(duration_s, sample_time, low, high)
    positive(piece_s=piece_s)
    share_between(smallest_share=smallest_share)
    if not 0.0 < frequency_Hz < 0.5 / sample_time:
        raise ValueError(f"frequency_Hz must be positive and below half the sampling rate, {0.5 / sample_time} Hz, not {frequency_Hz}")
    random, piece = np.random.default_rng(seed), (t / piece_s).astype(int)
    amplitude = random.uniform(smallest_share, 1.0, piece[-1] + 1)
    centre = random.uniform(-1.0, 1.0, piece[-1] + 1) * (1.0 - amplitude)
    blend = [smoothed(values[piece], min(0.2, 0.5 * piece_s), sample_time) for values in (amplitude, centre)]
    return scaled(0.5 + 0.5 * (blend[1] + blend[0] * np.sin(2.0 * np.pi * frequency_Hz * t)), low, high)


def from_samples(values: ArrayLike, *, duration_s: float, sample_time: float, low: float, high: float,
                 period_s: float = 10.0) -> Vector:
    """Any samples, a column of a file for example: one period of the signal, stretched over time and limits, over and over.

    Parameters
    ----------
    values : array (M,)
        At least two different finite numbers.
    period_s : float
        What the samples are stretched to, s; the last one is followed by the first.

    Examples
    --------
    >>> from_samples([3.0, 5.0], duration_s=4.0, sample_time=0.5, low=0.0, high=1.0, period_s=2.0).tolist()
    [0.0, 0.5, 1.0, 0.5, 0.0, 0.5, 1.0, 0.5]
    """
    t, v = times(duration_s, sample_time, low, high), np.asarray(values, dtype=np.float64)
    positive(period_s=period_s)
    if v.ndim != 1 or not np.all(np.isfinite(v)) or not np.ptp(v) > 0.0:
        raise ValueError("values must be a vector of finite numbers that are not all the same")
    shares = (v - v.min()) / np.ptp(v)
    return scaled(np.interp(t / period_s % 1.0 * v.size, np.arange(v.size + 1), np.append(shares, shares[0])), low, high)
