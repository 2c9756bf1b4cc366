"""Alternative models of a recording, outside the model class, each fitted by a few lines of least squares.

All of them take the drive u and the output v as shares of their ranges, shape (N,), uniformly sampled, and return the
RMS error of the fit as a share of the output's range, infinite if the model does not apply:

    curve       v = f(u), piecewise linear                    delay       v(k) = cubic in u(k − d)
    drift       v = polynomial in time                        resonance   v = b(z) / (1 − 2ρ cos φ z⁻¹ + ρ² z⁻²) u
    butterfly   v = f±(u), falling and rising                 channels    v = one cubic for even samples, one for odd
    backlash    v = line in one play of u                     ones
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from scipy.optimize import minimize
from scipy.signal import lfilter

from piezo_model.operators import play
from piezo_model.units import quantity
from solvers.arrays import Mask, Matrix, Vector

KNOTS = 24
PURE = 0.9
"""Smallest share of the drive's power in one tone at which delay, resonance and hysteresis cannot be distinguished."""
RADII = np.linspace(0.005, 0.495, 99)
"""Thresholds of plays, as shares of the drive's range."""
DISTINCT = 0.5
"""Largest ratio of the error of two cubics to that of one cubic that makes two channels."""
OUTLYING = 10.0
"""Smallest ratio of an outlier's distance from the median to that of any other sample."""
ROUNDING = 1e-12
"""Largest rounding error, as a share of the range."""
DAMPING = (0.003, 0.7)
"""Range of a resonance's damping ratio."""


class AlternativeModel(NamedTuple):
    """The error of a fitted model, and its parameter."""

    error: float
    parameter: float = 0.0


def residual(columns: Matrix, v: Vector, fitted: Mask | slice = slice(None)) -> Vector:
    """Residual (N,) of v (N,) for the combination of the columns (N, p) that is best over the fitted samples."""
    difference: Vector = v - columns @ np.linalg.lstsq(columns[fitted], v[fitted], rcond=None)[0]
    return difference


def polynomials(u: Vector, degree: int) -> Matrix:
    """Chebyshev polynomials of −1 ≤ u ≤ 1 up to a degree, shape (N, degree + 1)."""
    return np.asarray(chebvander(u, degree), dtype=np.float64)


def rms(error: Vector) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(error**2)))


def correlation(error: Vector) -> float:
    """Correlation of neighbouring samples: 0 for white noise, 1 for a slow signal."""
    e = error - error.mean()
    return float(e[1:] @ e[:-1] / max(e @ e, 1e-300))


def hats(u: Vector, knots: int = KNOTS) -> Matrix:
    """Piecewise linear functions of u over knots with equally many samples between them, shape (N, ≤ knots)."""
    at = np.unique(np.quantile(u, np.linspace(0.0, 1.0, knots)))
    return np.column_stack([np.interp(u, at, row) for row in np.eye(at.size)])


def rise(u: Vector, v: Vector) -> float:
    """Ratio of net change to total variation of the best piecewise linear curve: ±1 if it is monotone, 0 for a
    valley."""
    steps = np.diff(np.linalg.lstsq(hats(u, KNOTS // 2), v, rcond=None)[0])
    return float(steps.sum() / max(np.abs(steps).sum(), 1e-300))


def sense(u: Vector, v: Vector) -> float:
    """Sense of the loops: 1 if the output always lags the drive, −1 if it always leads."""
    error = residual(hats(u), v)
    area = 0.5 * (error[1:] + error[:-1]) * np.diff(u)
    return float(-np.sign(np.cov(u, v)[0, 1]) * np.sum(area) / max(np.sum(np.abs(area)), 1e-300))


def roughness(u: Vector) -> float:
    """1 − correlation of neighbouring samples; 1 − cos(2π/p) for a sine of p samples a period."""
    return float(np.mean(np.diff(u) ** 2) / (2.0 * max(u.var(), 1e-300)))


def unpredicted(u: Vector) -> float:
    """RMS error of a linear prediction from the four samples before, as a share of the standard deviation: small for
    tones, 1 for noise."""
    before = np.lib.stride_tricks.sliding_window_view(u[:-1] - u.mean(), 4)
    return rms(residual(before, u[4:] - u.mean())) / max(float(u.std()), 1e-300)


def is_noise(u: Vector, error: Vector, white: float) -> bool:
    """Whether an error is independent of itself and of the drive one sample before; that of a loop is not."""
    now, before = u[1:] - u.mean(), u[:-1] - u.mean()
    columns = np.column_stack([np.ones_like(now), now, before, now * before, before**2])
    return abs(correlation(error)) < white and rms(residual(columns, error[1:])) > (1.0 - 0.5 * white) * rms(error)


def outlier(v: Vector) -> int | None:
    """Index of a single outlier; None without one."""
    distance = np.abs(v - np.median(v))
    at = int(np.argmax(distance))
    return at if distance[at] > OUTLYING * np.max(np.delete(distance, at), initial=0.0) else None


def outlier_sentence(y: Vector, at: int, skip: int, unit: str) -> str:
    """A sentence about an outlier, without its full stop."""
    others = np.delete(y, at)
    return (
        f"the output is {quantity(float(y[at]), unit)} in sample {at + skip}, and from "
        f"{quantity(float(others.min()), unit)} to "
        f"{quantity(float(others.max()), unit)} in all others: an outlier"
    )


def drift(v: Vector) -> AlternativeModel:
    """A polynomial in time."""
    return AlternativeModel(rms(residual(polynomials(np.linspace(-1.0, 1.0, v.size), 5), v)))


def channels(u: Vector, v: Vector, samples: int) -> AlternativeModel:
    """One cubic for even samples and one for odd ones, fitted to spread pairs of samples; infinite if a single cubic is
    nearly as good."""
    even = 2 * np.arange(0, u.size // 2, max(1, u.size // samples))
    if min(np.unique(u[even + i]).size for i in (0, 1)) <= 4:  # a cubic fits any four points
        return AlternativeModel(np.inf)
    columns, values = [polynomials(2 * u[even + i] - 1, 3) for i in (0, 1)], [v[even + i] for i in (0, 1)]
    separate = rms(np.concatenate([residual(*channel) for channel in zip(columns, values, strict=True)]))
    joint = rms(residual(np.vstack(columns), np.concatenate(values)))
    return AlternativeModel(separate if separate < DISTINCT * joint and joint > ROUNDING else np.inf)


def butterfly(u: Vector, v: Vector) -> AlternativeModel:
    """One polynomial for each direction of the drive, neither of them monotone."""
    if abs(rise(u, v)) > 0.7:
        return AlternativeModel(np.inf)
    direction = np.sign(np.gradient(np.convolve(u, np.ones(5) / 5, "same")))
    columns = polynomials(2 * u - 1, 6)
    return AlternativeModel(rms(residual(np.hstack([columns, columns * direction[:, None]]), v)))


def backlash(u: Vector, v: Vector) -> AlternativeModel:
    """A straight line in a single play; ``parameter`` is the play's width as a share of the drive's range. The play
    starts at either side or in the middle."""
    best = AlternativeModel(np.inf)
    for side in (-1.0, 0.0, 1.0):
        z = play(u, RADII, u[0] + side * RADII)[0]
        z -= z.mean(axis=0)
        squares = np.mean(v**2) - np.square(v @ z / v.size) / np.maximum(np.mean(z**2, axis=0), ROUNDING)
        k = int(np.argmin(squares))
        best = min(best, AlternativeModel(float(np.sqrt(max(squares[k], 0.0))), 2.0 * float(RADII[k])))
    return best


def is_tonal(u: Vector, tones: int = 1) -> bool:
    """Whether nearly all of the drive's power is in a number of tones."""
    power = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(u.size))) ** 2
    total = power.sum()
    for _ in range(tones):
        top = int(np.argmax(power))
        power[max(top - 2, 0) : top + 3] = 0.0
    return bool(power.sum() < (1.0 - PURE) * total)


def phase_lag(u: Vector, v: Vector) -> tuple[float, float]:
    """Phase lag of the output in degrees at the drive's strongest tone, and that tone in cycles per sample."""
    U, V = (np.fft.rfft((signal - signal.mean()) * np.hanning(u.size)) for signal in (u, v))
    top = int(np.argmax(np.abs(U)))
    return float(np.degrees(np.angle(U[top] / V[top]))), top / u.size


def delay(u: Vector, v: Vector) -> AlternativeModel:
    """A cubic in the delayed drive; ``parameter`` is the delay in samples, up to a quarter of the recording."""
    longest = min(u.size // 4, 2000)
    if is_tonal(u):
        return AlternativeModel(np.inf)

    def fit(samples: int) -> AlternativeModel:
        delayed = u[longest - samples : u.size - samples]
        return AlternativeModel(rms(residual(polynomials(2 * delayed - 1, 3), v[longest:])), float(samples))

    coarse = np.unique(np.geomspace(1, max(longest, 1), 40).astype(int)).tolist()
    best = coarse.index(min(map(fit, coarse)).parameter)
    fine = np.linspace(coarse[max(best - 1, 0)], coarse[min(best + 1, len(coarse) - 1)], 40).astype(int)
    return min(map(fit, np.unique(fine).tolist()))


def resonance(u: Vector, v: Vector) -> AlternativeModel:
    """Two conjugate poles; ``parameter`` is the frequency in cycles per sample. Two tones determine no zeros."""
    if is_tonal(u):
        return AlternativeModel(np.inf)
    delays = (1,) if is_tonal(u, 2) else range(3)
    u = u - u[0]

    def error(at: Vector) -> float:
        rho, phi = 1.0 / (1.0 + np.exp(-at[0])), np.exp(at[1])
        poles = [1.0, -2.0 * rho * np.cos(phi), rho * rho]
        signals = [lfilter([0.0] * samples + [1.0], poles, u) for samples in delays]
        columns = [signal / (np.linalg.norm(signal) or 1.0) for signal in signals]
        return rms(residual(np.column_stack([*columns, np.ones_like(u)]), v))

    grid = [
        np.array([np.log(rho / (1.0 - rho)), np.log(phi)])
        for rho in (0.8, 0.95, 0.99, 0.997)
        for phi in np.geomspace(0.01, 2.5, 24)
    ]
    best = minimize(error, min(grid, key=error), method="Nelder-Mead", options={"maxfev": 80})
    rho, phi = 1.0 / (1.0 + np.exp(-best.x[0])), float(np.exp(best.x[1]))
    damping = -np.log(rho) / np.hypot(np.log(rho), phi)
    return AlternativeModel(
        float(best.fun) if DAMPING[0] < damping < DAMPING[1] and phi < np.pi else np.inf, phi / (2.0 * np.pi)
    )
