"""What the drive of a recording can determine: hysteresis, creep, a drift of the sensor, dynamics up to a frequency.

Dynamics are visible up to the highest frequency at which the output follows the drive, that is, at which their
coherence |S_xy|² / (S_xx S_yy) exceeds one half.

Source: P. D. Welch, "The use of fast Fourier transform for the estimation of power spectra", IEEE Trans. Audio
Electroacoust. 15 (1967) 70–73.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import csd

from piezo_model.identification.adequacy import ROUGH, is_monotonic, roughness
from piezo_model.identification.creep import CreepEvidence
from piezo_model.operators import play
from piezo_model.recordings import Recording
from piezo_model.units import quantity
from solvers.arrays import Vector

SAMPLES, SEGMENTS, LONGEST_SEGMENT, SHORTEST_SEGMENT = 1_000_000, 8, 8192, 16
"""Samples from the start that are analysed; segments of a part, and limits of the samples of a segment."""
REVERSAL, END = 0.05, 0.1
"""Smallest reversal, and width of either end of the drive's range, as shares of the range: a drive that reverses only
at the ends has no inner loops."""
BINS, MOST_LEVELS, TOO_FEW, ELSEWHERE = 100, 20, 4, 0.01
"""Bins of the drive's range; most levels of a staircase; most levels that determine no hysteresis; largest share of the
samples between the levels of a staircase."""
COHERENT, FAINT, HARDLY = 0.5, 1e-9, 1e-3
"""Smallest coherence; smallest power of a frequency, relative to the strongest one, above the leakage of the window;
share of the power that is hardly any."""


@dataclass(frozen=True)
class Identifiability:
    """What the drive of a recording can determine, whether the data contain it or not."""

    hysteresis: bool
    creep: bool
    drift: bool
    highest_Hz: float
    """Highest frequency at which the output follows the drive; 0 if there is none."""
    one_loop: bool
    """True if the drive reverses only at the ends of its range."""
    levels: int
    """Number of levels of a staircase, at most MOST_LEVELS; 0 for any other drive."""

    def sentence(self, creep: bool, dynamics: bool) -> str:
        """A sentence that names creep if the recording distinguishes it from hysteresis. Otherwise creep has a sentence
        of its own (`creep`), as have the dynamics of a model."""
        drift = "a drift of the sensor" if creep else "a drift"  # which may be creep
        effects = {"hysteresis": self.hysteresis, "creep": creep, drift: self.drift}
        can = _listed([name for name, shown in effects.items() if shown], "and")
        cannot = _listed([name for name, shown in effects.items() if not shown and name != "creep"], "or")
        but = f", but not {cannot}" if can and cannot else ""
        shows = f"dynamics up to {quantity(self.highest_Hz, 'Hz', 2)}" if self.highest_Hz else "no dynamics"
        known = f"; it shows {shows}" * bool(self.highest_Hz or not dynamics)
        alone = " It reverses only at the ends of its range, and says little about inner loops." * self.one_loop
        return f"This drive determines {can or 'none of hysteresis, creep and drift'}{but}{known}.{alone}"


def _listed(names: Sequence[str], last: str) -> str:
    return f" {last} ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def identifiability_of(recording: Recording, skip: int, evidence: CreepEvidence) -> Identifiability:
    """What the drive of a recording can determine, without the skipped samples."""
    x = recording.x[skip:]
    levels = level_count(x)
    hysteresis = not is_monotonic(x) and roughness(x) <= ROUGH and not 0 < levels <= TOO_FEW
    one_loop, (_, highest) = hysteresis and has_one_loop(x), band_of(recording)
    return Identifiability(hysteresis, bool(evidence.rates), evidence.shows_drift, highest, one_loop, levels)


def level_count(x: Vector) -> int:
    """Number of levels of a staircase (N,), from 2 to MOST_LEVELS, between which a pulse moves too; 0 for any other
    drive.

    Examples
    --------
    >>> level_count(np.repeat([0.0, 1.0, 0.0, 1.0], 500)), level_count(np.linspace(0.0, 1.0, 2000))
    (2, 0)
    >>> level_count(np.sin(np.arange(16)))
    0
    """
    counts = np.sort(np.histogram(x, BINS)[0])[::-1]
    levels = 2 + int(np.searchsorted(np.cumsum(counts)[1:], (1.0 - ELSEWHERE) * x.size))
    return levels if levels <= min(MOST_LEVELS, x.size // 2) else 0  # a level is held


def orders_within(x: Vector, n: int, m: int) -> tuple[int, int]:
    """Orders n and m, reduced to what the levels of a drive (N,) determine: one threshold between two levels.

    Examples
    --------
    >>> orders_within(np.repeat([0.0, 1.0, 0.0, 1.0], 500), 5, 3), orders_within(np.linspace(0.0, 1.0, 2000), 5, 3)
    ((1, 0), (5, 3))
    """
    levels = level_count(x) or math.inf
    return int(min(n, levels - 1)), int(min(m, (levels - 1) / 2))


def has_one_loop(x: Vector) -> bool:
    """True if a drive (N,) reverses, and only at the ends of its range.

    Examples
    --------
    >>> swing = np.sin(np.linspace(0.0, 60.0, 3000))
    >>> has_one_loop(swing), has_one_loop(swing * np.linspace(1.0, 0.1, 3000))
    (True, False)
    """
    u = (x - x.min()) / max(float(np.ptp(x)), 1e-300)
    z = play(u, np.array([0.5 * REVERSAL]), u[:1])[0][:, 0]
    moving = np.flatnonzero(np.diff(z))
    turns = z[moving[1:]][np.diff(np.sign(np.diff(z)[moving])) != 0.0]
    return bool(turns.size and np.all(np.abs(turns - 0.5) > 0.5 - END))


def band_of(recording: Recording) -> tuple[float, float]:
    """Frequencies in Hz: the one below which the drive has hardly any power, and the highest at which the output
    follows it; infinite and 0 for a recording that is too short.

    Examples
    --------
    >>> t = np.arange(20_000) / 1000
    >>> x, noise = np.sin(2 * np.pi * t**2), np.random.default_rng(0).normal(size=t.size)
    >>> low, high = band_of(Recording.from_arrays(x, 2 * x + 0.01 * noise, 1e-3))
    >>> low < 1, 38 < high < 45
    (True, True)
    """
    lowest, highest = math.inf, 0.0
    for sample_time, part in zip(recording.periods, recording.parts, strict=True):
        x, y = (signal[part][: max(0, SAMPLES - part.start)] for signal in (recording.x, recording.y))
        segment = min(LONGEST_SEGMENT, x.size // SEGMENTS)
        if segment < SHORTEST_SEGMENT:
            continue
        spectra = [csd(*pair, 1.0 / sample_time, "blackmanharris", segment) for pair in ((x, x), (y, y), (x, y))]
        f, (xx, yy, xy) = spectra[0][0], (np.abs(spectrum) for _, spectrum in spectra)
        follows = (xy**2 > COHERENT * xx * yy) & (xx > FAINT * xx.max())
        lowest = min(lowest, float(f[np.cumsum(xx) >= HARDLY * xx.sum()][0]))
        highest = max(highest, float(f[follows].max(initial=0.0)))
    return lowest, highest
