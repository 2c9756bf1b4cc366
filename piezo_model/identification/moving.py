"""Whether a resonance moves: with the amplitude of its vibration, as of a spring that hardens or softens, or with the
position of the stage,

    log f(t) = log f + β₁ A² + β₂ p + β₃ p²,

where p is the mean of the output over a period, and A the amplitude of its difference from the static output.

With the poles D(z) of the mode, the derivative of the output by log f is J = s / D(z), and that by β_i is m_i s / D(z),
where m_i is A², p or p²: three further columns of one Gauss–Newton step. The resonance moves if β is not 0 by the
intervals of the module `intervals`.

Source: A. H. Nayfeh and D. T. Mook, Nonlinear Oscillations, 1979, section 2.3, for the frequency of a nonlinear spring.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from piezo_model.dynamics import Dynamics
from piezo_model.identification.dynamics_parameters import STEP
from piezo_model.identification.forward import Columns, ForwardFit
from solvers.arrays import Matrix, Vector

SIGNIFICANT = 3.0
"""Smallest β, in standard errors."""
USUAL = (0.05, 0.95)
"""Quantiles of the frequencies, by the squares of s, between which a resonance is said to move."""


def movement(fit: ForwardFit, mode: int, T: float, refit: Callable[[Columns], ForwardFit]) -> tuple[float, float]:
    """Lowest and highest frequency in Hz of a mode; the same twice for one that does not move. A step from the fit with
    further columns is ``refit``."""
    assert fit.dynamics is not None
    parts = [_moved(fit.dynamics, mode, T, fit.static[part], fit.y_model[part]) for part in fit.parts]
    signals, shapes, source = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    free = np.full(signals.shape[1], np.inf)
    other = refit(Columns(signals, -free, free))
    at = slice(other.structure.d, other.structure.d + free.size)
    beta, f = other.further, fit.dynamics.frequencies_Hz[mode]
    if beta @ np.linalg.pinv(other.covariance[at, at], hermitian=True) @ beta < SIGNIFICANT**2 * free.size:
        return f, f
    change = shapes @ beta
    change -= np.average(change, weights=source**2)
    low, high = np.quantile(change, USUAL, weights=source**2, method="inverted_cdf").tolist()
    return f * math.exp(low), f * math.exp(high)


def _moved(g: Dynamics, mode: int, T: float, static: Vector, y: Vector) -> tuple[Matrix, Matrix, Vector]:
    """The columns (N, 3), the m_i (N, 3) and s (N,)."""
    f, D = list(g.frequencies_Hz), g.pole_pairs(T)[mode][0]
    period = max(1, round(1.0 / f[mode] / T))
    f[mode] *= math.exp(STEP)
    J = (replace(g, frequencies_Hz=tuple(f)).filter(static, T) - g.filter(static, T)) / STEP
    source, p = lfilter(D, [1.0], J), uniform_filter1d(y, period)
    shapes = np.column_stack([uniform_filter1d(2.0 * (y - static) ** 2, period), p, p**2])
    return lfilter([1.0], D, shapes * source[:, None], axis=0), shapes, source
