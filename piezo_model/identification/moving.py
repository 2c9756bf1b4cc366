"""Whether a resonance moves, with the amplitude of its vibration (a spring that hardens or softens) or with the
position of the stage:

    log f(t) = log f + β₁ A² + β₂ p + β₃ p²,

where p is the mean of the output over a period, and A the amplitude of its difference from the static output.

With the poles D(z) of the mode, the derivative of the output with respect to log f is J = s / D(z), and that with
respect to β_i is m_i s / D(z), where m_i is A², p or p²: three further columns of the forward fit. The error of the
static part also biases β, and like J it follows the drive, so that it is concentrated at few harmonics. With the
columns w of J P⁻¹ / N, the error of β is Σ w e, and its covariance is the sum over the frequencies

    C = Σ_k W_k* W_kᵀ |E_k|² / N²,

with the effective number of independent frequencies by Welch and Satterthwaite. The resonance moves if an F test
rejects β = 0, with C plus the covariance of the module `intervals`, since C underestimates slow errors.
In either case the standard deviation of log f(t), less the share 1/F that chance explains, measures how far parts of
the recording disagree on f, and adds to the uncertainty of f.

Sources: A. H. Nayfeh and D. T. Mook, Nonlinear Oscillations, 1979, section 2.3, for the frequency of a nonlinear
spring; E. J. Hannan, "Regression for time series", 1963, for C; F. E. Satterthwaite, Biometrics Bulletin 2 (1946)
110–114, for the number of independent frequencies.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter
from scipy.stats import f as f_distribution

from piezo_model.dynamics import Dynamics
from piezo_model.identification.autocorrelation import inverse_over
from piezo_model.identification.dynamics_parameters import STEP
from piezo_model.identification.forward import Columns, ForwardFit
from solvers.arrays import Matrix, Vector

CHANCE, USUAL = 1e-4, (0.05, 0.95)
"""Significance level of the F test; quantiles of f(t), weighted by s², between which a resonance is said to move."""


def movement(
    fit: ForwardFit, mode: int, T: float, refit: Callable[..., ForwardFit]
) -> tuple[tuple[float, float], float]:
    """Lowest and highest frequency in Hz of a mode, which are equal if it does not move, and the standard deviation of
    log f(t) beyond chance. ``refit`` fits dynamics from another fit, with further columns."""
    assert fit.dynamics is not None
    parts = [_columns(fit.dynamics, mode, T, fit.static[part], fit.y_model[part]) for part in fit.recording.parts]
    signals, shapes, weights = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    other, f = refit(fit.parameters, fit, further=Columns.of(signals)), fit.dynamics.frequencies_Hz[mode]
    change = shapes @ other.further
    change -= np.average(change, weights=weights)
    ends = np.quantile(change, USUAL, weights=weights, method="inverted_cdf")
    ratio, p_value = _f_test(replace(other, P=other.P_here()))
    low, high = (f * np.exp(ends * (p_value < CHANCE))).tolist()
    return (low, high), math.sqrt((1.0 - 1.0 / max(ratio, 1.0)) * np.average(change**2, weights=weights))


def _f_test(fit: ForwardFit) -> tuple[float, float]:
    """F of the further weights of a fit, about 1 if they are 0, and its p-value."""
    free, samples = np.flatnonzero(fit.free[fit.structure.d :][: fit.further.size]), np.count_nonzero(fit.counted)
    if not free.size:
        return 0.0, 1.0
    beta, directions = fit.further[free], inverse_over(fit.P, fit.free)[fit.structure.d + free] / samples
    w = np.column_stack([fit.derivative(direction) for direction in directions])
    pairs = zip((w[part][fit.counted[part]] for part in fit.recording.parts), fit.errors, strict=True)
    lines = np.concatenate(
        [np.fft.rfft(own, axis=0) * np.abs(np.fft.rfft(e))[:, None] / e.size for own, e in pairs if e.size]
    )
    at = np.ix_(fit.structure.d + free, fit.structure.d + free)
    inverse = np.linalg.pinv(2.0 * (lines.conj().T @ lines).real + fit.covariance_over(fit.free)[at], hermitian=True)
    share = np.einsum("fi,ij,fj->f", lines.conj(), inverse, lines).real
    independent = 2.0 * share.sum() ** 2 / max(float(np.sum(share**2)), 1e-300)
    ratio = float(beta @ inverse @ beta) / free.size
    return ratio, float(f_distribution.sf(ratio, free.size, independent))


def _columns(g: Dynamics, mode: int, T: float, static: Vector, y: Vector) -> tuple[Matrix, Matrix, Vector]:
    """The columns (N, 3), the m_i (N, 3) and s² (N,)."""
    f, D = list(g.frequencies_Hz), g.pole_pairs(T)[mode][0]
    period = max(1, round(1.0 / f[mode] / T))
    f[mode] *= math.exp(STEP)
    J = (replace(g, frequencies_Hz=tuple(f)).filter(static, T) - g.filter(static, T)) / STEP
    source, p = lfilter(D, [1.0], J), uniform_filter1d(y, period)
    shapes = np.column_stack([uniform_filter1d(2.0 * (y - static) ** 2, period), p, p**2])
    return lfilter([1.0], D, shapes * source[:, None], axis=0), shapes, source**2
