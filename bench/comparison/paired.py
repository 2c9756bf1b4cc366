"""Whether one sample of times is longer than another: paired log-ratios and a block bootstrap.

Of the raw times a_i and b_i of two runs of the same task, paired by their place in the sequence so that warming up cancels,
the effect is the median log-ratio

    θ = median_i log(b_i / a_i).

Times follow each other with memory, so θ is resampled by circular blocks of length L = ⌈N^(1/3)⌉ of pairs; s is its
standard deviation over the resamples. With several processes R (repeats) θ is the median of theirs.

What s cannot see is what changes from process to process, where memory lies and which clock rate the core settles at. This
*noise band* τ of one process comes from two runs of the same (A/A), as what the robust spread of θ over all rows has above
s, or, without any, from the rows that are compared: most of them do not differ (Efron's empirical null). What comes and goes
with time, a neighbour or the clock rate, shifts all rows that were measured together; their median m is taken off. Then

    t = (θ − m) / √(s² + τ²/R),   p = 2 P(T > |t|),   T of Student's distribution with min(FREEDOM·R, N − R) degrees,

since θ over A/A rows has heavier tails than the normal law, the less so the more processes are in it, and since s of N pairs
in all is itself uncertain where they are few.

Sources: D. N. Politis and J. P. Romano (1992) on the circular block bootstrap; B. Efron, J. Amer. Statist. Assoc. 99 (2004)
96 to 104; S. Holm, Scand. J. Statist. 6 (1979) 65 to 70; Y. Benjamini and Y. Hochberg, J. R. Statist. Soc. B 57 (1995)
289 to 300.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

Vector = NDArray[np.float64]
Index = NDArray[np.intp]

RESAMPLES = 400
FREEDOM = 5
NORMAL = 1.4826
"""From a median absolute deviation to a standard deviation."""


@dataclass(frozen=True)
class Effect:
    """How much longer b is than a.

    Attributes
    ----------
    log_ratio, deviation : float
        θ and its s.
    pairs, processes : int
    """

    log_ratio: float
    deviation: float
    pairs: int
    processes: int

    @property
    def freedom(self) -> int:
        """Degrees of freedom of its t."""
        return max(1, min(FREEDOM * self.processes, self.pairs - self.processes))


def log_ratios(a: ArrayLike, b: ArrayLike) -> Vector:
    """log(b_i / a_i) for as many as both have, shape (N,)."""
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    count = min(first.size, second.size)
    return np.log(np.maximum(second[:count], 1.0)) - np.log(np.maximum(first[:count], 1.0))


def effect(processes: Sequence[Vector], generator: np.random.Generator, resamples: int = RESAMPLES) -> Effect:
    """The effect with its deviation.

    Parameters
    ----------
    processes : sequence of array
        Log-ratios of each pair of processes, none empty.
    generator : numpy Generator
        What resampling draws from.

    Examples
    --------
    >>> e = effect([np.full(50, 0.5)], np.random.default_rng(0))
    >>> e.log_ratio, e.deviation
    (0.5, 0.0)
    """
    resampled = np.median([_resampled_medians(ratios, generator, resamples) for ratios in processes], axis=0)
    theta = float(np.median([np.median(ratios) for ratios in processes]))
    return Effect(theta, float(np.std(resampled)), sum(ratios.size for ratios in processes), len(processes))


def _resampled_medians(ratios: Vector, generator: np.random.Generator, resamples: int) -> Vector:
    """Medians of ``resamples`` sequences that are put together from circular blocks."""
    n = ratios.size
    length = math.ceil(n ** (1.0 / 3.0))
    starts = generator.integers(n, size=(resamples, math.ceil(n / length)))
    places = (starts[:, :, None] + np.arange(length)) % n
    return np.asarray(np.median(ratios[places.reshape(resamples, -1)[:, :n]], axis=1), dtype=np.float64)


def noise_band(effects: Sequence[Effect], common: ArrayLike = 0.0) -> float:
    """τ of one process from many rows most of which do not differ.

    Examples
    --------
    >>> round(noise_band([Effect(theta, 0.0, 50, 1) for theta in (-0.01, 0.0, 0.01, 0.7)]), 4)
    0.0148
    """
    if not effects:
        return 0.0
    theta = np.array([each.log_ratio for each in effects]) - np.asarray(common, dtype=np.float64)
    spread = NORMAL * float(np.median(np.abs(theta - np.median(theta))))
    within = float(np.median([each.deviation for each in effects]))
    processes = float(np.median([each.processes for each in effects]))
    return math.sqrt(max(spread**2 - within**2, 0.0) * processes)


def p_values(effects: Sequence[Effect], noise: float, common: ArrayLike = 0.0) -> Vector:
    """Two-sided p of each effect against ``common``, what rows share that were measured together, shape () or (effects,)."""
    theta = np.array([each.log_ratio for each in effects]) - np.asarray(common, dtype=np.float64)
    scale = np.array([math.hypot(each.deviation, noise / math.sqrt(each.processes)) for each in effects])
    ratio = np.divide(np.abs(theta), scale, out=np.where(theta == 0.0, 0.0, np.inf), where=scale > 0.0)
    return np.asarray(2.0 * student.sf(ratio, np.array([each.freedom for each in effects])), dtype=np.float64)


def holm(p: ArrayLike) -> Vector:
    """P-values adjusted so that any false one among all is as rare as asked for.

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03]).tolist()
    [0.03, 0.06, 0.06]
    """
    values = np.asarray(p, dtype=np.float64)
    order = np.argsort(values)
    adjusted = np.maximum.accumulate(values[order] * np.arange(values.size, 0, -1))
    return _in_place(np.minimum(adjusted, 1.0), order)


def benjamini_hochberg(p: ArrayLike) -> Vector:
    """P-values adjusted so that the share of false ones among those called significant is as small as asked for.

    Examples
    --------
    >>> benjamini_hochberg([0.01, 0.04, 0.03]).tolist()
    [0.03, 0.04, 0.04]
    """
    values = np.asarray(p, dtype=np.float64)
    order = np.argsort(values)
    scaled = values[order] * values.size / np.arange(1, values.size + 1)
    adjusted = np.minimum.accumulate(scaled[::-1])[::-1]
    return _in_place(np.minimum(adjusted, 1.0), order)


def _in_place(sorted_values: Vector, order: Index) -> Vector:
    result = np.empty_like(sorted_values)
    result[order] = sorted_values
    return result
