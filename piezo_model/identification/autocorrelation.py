"""The autocorrelation time of an error, τ = 1 + 2 Σ ρ_k, so that N / τ of its samples are independent.

Source: A. Sokal, "Monte Carlo methods in statistical mechanics", 1996, section 3, for the window of the sum of ρ_k.
"""

from collections.abc import Sequence

import numpy as np

from solvers.arrays import Mask, Matrix, Vector

DEVIATIONS, WINDOW = 1.96, 6.0
"""Half width of a 95 % interval in standard deviations; window of the sum, in autocorrelation times."""


def autocorrelation_time(errors: Sequence[Vector]) -> float:
    """1 + 2 Σ ρ_k of the errors (N,) of the parts, at least 1.

    Examples
    --------
    >>> bool(autocorrelation_time([np.random.default_rng(0).normal(size=10_000)]) < 1.1)
    True
    """
    mean, size = np.concatenate(errors).mean(), max(error.size for error in errors)
    power = sum(np.abs(np.fft.rfft(error - mean, 2 * size)) ** 2 for error in errors)
    correlation = np.fft.irfft(power)[:size]
    if correlation[0] <= 0.0:
        return 1.0
    times = 2.0 * np.cumsum(correlation / correlation[0]) - 1.0
    ended = np.flatnonzero(np.arange(times.size) >= WINDOW * times)
    return max(1.0, float(times[ended[0] if ended.size else -1]))


def independent_samples(errors: Sequence[Vector]) -> float:
    """Number of independent samples in the errors (N,) of the parts, from their periodograms S: the sum of
    N_e = 4 (Σ S)² / Σ S², which is N for white noise.

    Examples
    --------
    >>> white = np.random.default_rng(0).normal(size=4000)
    >>> 3000 < independent_samples([white]) < 4500 and independent_samples([np.cumsum(white)]) < 40
    True
    """
    total = 0.0
    for error in errors:
        power = np.abs(np.fft.rfft(error - error.mean()))[1:] ** 2 if error.size else np.zeros(1)
        total += 4.0 * float(power.sum()) ** 2 / max(float(np.sum(power**2)), 1e-300)
    return max(total, 3.0)


def inverse_over(P: Matrix, free: Mask) -> Matrix:
    """Inverse of P over the free unknowns, and 0 elsewhere."""
    inverse, at = np.zeros_like(P), np.ix_(free, free)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(P)[free], np.finfo(float).tiny))
    inverse[at] = np.linalg.pinv(P[at] * np.outer(scale, scale), rcond=1e-14, hermitian=True) * np.outer(scale, scale)
    return inverse
