"""Drive and reference signals s(k), k = 0 … N − 1 at the times k Ts, with N = duration / Ts.

Every signal takes ``duration_s`` and ``sample_time`` in s, ``low`` and ``high`` in its own unit (V for a drive, µm for
a reference), and returns an array (N,). It stays inside low ≤ s ≤ high and is a pure function of its arguments. The
staircase is that of the paper's Fig. 4; the decaying triangle moves every play in both directions; the multi-sine has
the phases of M. R. Schroeder, "Synthesis of low-peak-factor signals and binary sequences with low autocorrelation",
IEEE Transactions on Information Theory 16 (1970), 85-89. These are designed for harmonic tones; with log-spaced tones
the crest factor, about 3, is no better than with most random phases, but well below the 5 of cosines in phase.
"""

import math
from collections.abc import Callable

import numpy as np
import scipy  # its parts are imported when they are first used

from piezo_model import checks
from solvers.arrays import Vector

TRIANGLES = (0.3, 0.06, 0.012)
"""Durations of the triangles of an excitation, relative to the whole."""
SLOWEST, FEWEST = 2.0, 2000
"""Initial frequency of the swept sine in cycles per duration; fewest samples of an excitation."""
SWEPT = 20
"""Samples in the last period of the swept sine."""


def times(duration_s: float, sample_time: float, low: float, high: float) -> Vector:
    """Check the arguments that all signals share and return the sample times, s, shape (N,)."""
    checks.positive(duration_s=duration_s, sample_time=sample_time)
    checks.ascending(**{"low and high": (low, high)})
    count = round(duration_s / sample_time)
    checks.check(count >= 1, f"duration_s = {duration_s} is shorter than one sample_time = {sample_time}")
    return np.arange(count, dtype=np.float64) * sample_time


def scaled(share: Vector, low: float, high: float) -> Vector:
    """Map 0 … 1 to low … high; clipped, since rounding may exceed a limit by one bit."""
    return np.clip(low + (high - low) * share, low, high)


def _triangle(phase: Vector) -> Vector:
    """Triangle of period 1 that rises from 0 at phase 0 to 1 at phase ½ and falls back."""
    return 1.0 - np.abs(1.0 - 2.0 * (phase % 1.0))


def staircase(
    *, duration_s: float, sample_time: float, low: float, high: float, levels: int = 9, hold_s: float = 0.25
) -> Vector:
    """Steps up through the levels and down again, each level held, repeated (the paper's Fig. 4).

    Parameters
    ----------
    levels : int
        Number of levels including low and high, at least 2.
    hold_s : float
        Duration of each level, s; the first level is low.

    Examples
    --------
    >>> staircase(duration_s=6.0, sample_time=1.0, low=0.0, high=10.0, levels=3, hold_s=1.0).tolist()
    [0.0, 5.0, 10.0, 5.0, 0.0, 5.0]
    """
    t = times(duration_s, sample_time, low, high)
    checks.positive(hold_s=hold_s)
    checks.whole(2, levels=levels)
    # In whole samples, so that the rounding of k Ts / hold_s never shifts a step.
    step = np.arange(t.size) // max(1, round(hold_s / sample_time)) % (2 * (levels - 1))
    return np.linspace(low, high, levels)[np.minimum(step, 2 * (levels - 1) - step)]


def decaying_triangle(
    *, duration_s: float, sample_time: float, low: float, high: float, cycles: float = 8.0, final_share: float = 0.0
) -> Vector:
    """Triangle about the centre: it rises from low to high, then its amplitude decreases linearly.

    Parameters
    ----------
    cycles : float
        Number of cycles in the duration, at least 1.
    final_share : float
        Amplitude at the end over amplitude at the start, 0 to 1.
    """
    t = times(duration_s, sample_time, low, high)
    checks.require(lambda value: 1.0 <= value < math.inf, "at least 1", cycles=cycles)
    checks.require(lambda value: 0.0 <= value <= 1.0, "between 0 and 1", final_share=final_share)
    cycle = cycles * t / duration_s
    amplitude = 1.0 - (1.0 - final_share) * np.maximum(cycle - 0.5, 0.0) / (cycles - 0.5)
    return scaled(0.5 + amplitude * (_triangle(cycle) - 0.5), low, high)


def multi_sine(
    *,
    duration_s: float,
    sample_time: float,
    low: float,
    high: float,
    tones: int = 12,
    lowest_Hz: float | None = None,
    highest_Hz: float = 50.0,
    seed: int | None = None,
) -> Vector:
    """Sum of sines of equal amplitude at log-spaced frequencies, scaled to touch both limits.

    Parameters
    ----------
    tones : int
        Number of sines.
    lowest_Hz, highest_Hz : float
        Frequencies of the first and the last sine; lowest_Hz is by default one period in the duration.
    seed : int, optional
        Seed of random phases; by default Schroeder's phases, −π j (j − 1) / tones for j = 1 … tones.
    """
    t = times(duration_s, sample_time, low, high)
    checks.whole(1, tones=tones)
    first_Hz = 1.0 / duration_s if lowest_Hz is None else lowest_Hz
    checks.check(
        0.0 < first_Hz <= highest_Hz < 0.5 / sample_time,
        f"lowest_Hz = {first_Hz} and highest_Hz = {highest_Hz} must be positive, in this order, and "
        f"below half the sampling rate, {0.5 / sample_time} Hz",
    )
    j = np.arange(1, tones + 1)
    schroeder = -np.pi * j * (j - 1) / tones
    phases = schroeder if seed is None else np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, tones)
    total = np.zeros(t.size)
    for frequency_Hz, phase in zip(np.geomspace(first_Hz, highest_Hz, tones), phases, strict=True):
        total += np.sin(2.0 * np.pi * frequency_Hz * t + phase)
    width = float(np.ptp(total))
    return scaled((total - total.min()) / width if width > 0.0 else np.full(t.size, 0.5), low, high)


def random_walk(
    *,
    duration_s: float,
    sample_time: float,
    low: float,
    high: float,
    seed: int,
    bandwidth_Hz: float = 20.0,
    spread_per_root_s: float = 1.0,
) -> Vector:
    """Brownian path from the centre, reflected at the limits and smoothed by two lags of first order.

    The lags come after the reflection: their output is a weighted mean of their input, so the smoothed path has no
    kinks and stays inside the limits.

    Parameters
    ----------
    seed : int
        Seed of the path.
    bandwidth_Hz : float
        Corner frequency of each lag.
    spread_per_root_s : float
        Standard deviation of the free path after one second, over high - low.
    """
    t = times(duration_s, sample_time, low, high)
    checks.positive(bandwidth_Hz=bandwidth_Hz, spread_per_root_s=spread_per_root_s)
    increments = np.random.default_rng(seed).standard_normal(t.size) * spread_per_root_s * math.sqrt(sample_time)
    increments[0] = 0.0
    path = _triangle(0.5 * (0.5 + np.cumsum(increments)))
    keep = math.exp(-2.0 * math.pi * bandwidth_Hz * sample_time)
    for _ in range(2):
        path, _state = scipy.signal.lfilter([1.0 - keep], [1.0, -keep], path, zi=[keep * 0.5])
    return scaled(path, low, high)


def smoothed(steps: Vector, step_s: float, sample_time: float) -> Vector:
    """Replace each step of a signal (N,) by a raised cosine of ``step_s``; the signal is constant before its start."""
    window = np.hanning(round(step_s / sample_time) + 2)[1:-1]
    if window.size < 2:
        return steps
    padded = np.concatenate([np.full(window.size - 1, steps[0]), steps])
    smooth: Vector = scipy.signal.oaconvolve(padded, window / window.sum(), "valid")
    return np.clip(smooth, steps.min(), steps.max())


def excitation(*, duration_s: float, sample_time: float, low: float, high: float, step_s: float = 5e-3) -> Vector:
    """Drive that determines hysteresis, creep, a drift of the sensor and dynamics; it starts and ends at low.

    Decaying triangles at three speeds, each five times as fast as the previous one, move every play at every amplitude.
    Two holds, each a sixth of the duration, show creep. A sine swept up to a twentieth of the sampling rate, with an
    amplitude that falls as 1/f to bound its speed, shows dynamics. In between the drive rests at low, which shows a
    drift.

    Parameters
    ----------
    step_s : float
        Duration of each step, a raised cosine, s.

    Raises
    ------
    ValueError
        If there are fewer than 2000 samples.

    Examples
    --------
    >>> drive = excitation(duration_s=60.0, sample_time=1e-3, low=0.0, high=100.0)
    >>> drive.size, float(drive[0]), round(float(drive.max())), float(drive[-1])
    (60000, 0.0, 100, 0.0)
    """
    count = times(duration_s, sample_time, low, high).size
    checks.check(count >= FEWEST, f"{duration_s:g} s gives {count} samples, and an excitation needs {FEWEST}")
    rest, hold = np.full(count // 50, low), count // 6
    triangles = [
        decaying_triangle(duration_s=share * duration_s, sample_time=sample_time, low=low, high=high, final_share=0.1)
        for share in TRIANGLES
    ]
    swept = np.linspace(0.0, 1.0, count // 10)
    growth = math.log(swept.size / SWEPT / SLOWEST)
    cycles, amplitude = SLOWEST * np.expm1(growth * swept) / growth, np.minimum(1.0, 10.0 * np.exp(-growth * swept))
    sine = scaled(0.5 * amplitude * (1.0 - np.cos(2.0 * np.pi * cycles)), low, high)
    holds = [np.full(hold, low + share * (high - low)) for share in (0.8, 0.2)]
    segments = (rest, triangles[0], rest, holds[0], rest, triangles[1], rest, holds[1], rest, sine, rest, triangles[2])
    drive = np.concatenate(segments)
    return smoothed(np.concatenate([drive, np.full(count - drive.size, low)]), step_s, sample_time)


SIGNALS: dict[str, Callable[..., Vector]] = {
    function.__name__: function for function in (staircase, decaying_triangle, multi_sine, random_walk)
}
"""The signals by name."""
