"""Explanations of a recording that the model class has no part in, each a few lines of least squares.

All of them take the drive u and the output v as shares of their ranges, shape (N,), uniformly sampled, and give the RMS
error that the explanation leaves, as a share of the output's range, infinite where it does not apply:

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
"""Share of the drive's power in one tone from which on delay, resonance and hysteresis look the same."""
RADII = np.linspace(0.005, 0.495, 99)
"""Of plays, as shares of the drive's range."""
APART = 0.5
"""Share of the error of one cubic for all below which two cubics are two channels."""
OUTLYING = 10.0
ROUNDING = 1e-12
"""Of the range; what is smaller says nothing."""
DAMPING = (0.003, 0.7)
"""Range of the damping ratio that makes a resonance."""


class AlternativeModel(NamedTuple):
    """An explanation: the error that it leaves, and what it found."""

    error: float
    found: float = 0.0


def left_over(columns: Matrix, v: Vector, fitted: Mask | slice = slice(None)) -> Vector:
    """What the best combination of the columns (N, p) over the samples that it is fitted to leaves of v (N,)."""
    residual: Vector = v - columns @ np.linalg.lstsq(columns[fitted], v[fitted], rcond=None)[0]
    return residual


def polynomials(u: Vector, degree: int) -> Matrix:
    """Chebyshev polynomials of −1 ≤ u ≤ 1 up to a degree, shape (N, degree + 1)."""
    return np.asarray(chebvander(u, degree), dtype=np.float64)


def rms(error: Vector) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(error**2)))


def correlation(error: Vector) -> float:
    """Correlation of neighbouring samples: 0 for noise, 1 for what changes slowly."""
    e = error - error.mean()
    return float(e[1:] @ e[:-1] / max(e @ e, 1e-300))


def hats(u: Vector, knots: int = KNOTS) -> Matrix:
    """Piecewise linear functions of u over knots that have as many samples between them, shape (N, ≤ knots)."""
    at = np.unique(np.quantile(u, np.linspace(0.0, 1.0, knots)))
    return np.column_stack([np.interp(u, at, row) for row in np.eye(at.size)])


def rise(u: Vector, v: Vector) -> float:
    """Net change of the best piecewise linear curve over all that it goes up and down: ±1 for a monotone one, 0 for a
    valley."""
    steps = np.diff(np.linalg.lstsq(hats(u, KNOTS // 2), v, rcond=None)[0])
    return float(steps.sum() / max(np.abs(steps).sum(), 1e-300))


def sense(u: Vector, v: Vector) -> float:
    """Sense of the loops, 1 where the output always lags behind the drive and −1 where it always leads."""
    residual, way = left_over(hats(u), v), np.diff(u)
    middle = 0.5 * (residual[1:] + residual[:-1])
    return float(-np.sign(np.cov(u, v)[0, 1]) * np.sum(middle * way) / max(np.sum(np.abs(middle * way)), 1e-300))


def roughness(u: Vector) -> float:
    """1 − correlation of neighbouring samples; 1 − cos(2π/p) for a sine of p samples a period."""
    return float(np.mean(np.diff(u) ** 2) / (2.0 * max(u.var(), 1e-300)))


def unforeseen(u: Vector) -> float:
    """What four samples before leave open of the next, as a share of the standard deviation: small for tones, 1 for
    noise."""
    before = np.lib.stride_tricks.sliding_window_view(u[:-1] - u.mean(), 4)
    return rms(left_over(before, u[4:] - u.mean())) / max(float(u.std()), 1e-300)


def noise(u: Vector, error: Vector, white: float) -> bool:
    """Whether an error follows neither itself nor the drive of the sample before, as it does round a loop."""
    now, before = u[1:] - u.mean(), u[:-1] - u.mean()
    columns = np.column_stack([np.ones_like(now), now, before, now * before, before**2])
    return abs(correlation(error)) < white and rms(left_over(columns, error[1:])) > (1.0 - 0.5 * white) * rms(error)


def outlier(v: Vector) -> int | None:
    """The one sample that lies OUTLYING times as far from the median as any other; None where there is none."""
    away = np.abs(v - np.median(v))
    at = int(np.argmax(away))
    return at if away[at] > OUTLYING * np.max(np.delete(away, at), initial=0.0) else None


def outlier_sentence(y: Vector, at: int, skip: int, unit: str) -> str:
    """What a sample is that stands alone; without a full stop."""
    others = np.delete(y, at)
    return (
        f"the output is {quantity(float(y[at]), unit)} in sample {at + skip}, and from "
        f"{quantity(float(others.min()), unit)} to "
        f"{quantity(float(others.max()), unit)} in all others: an outlier"
    )


def drift(v: Vector) -> AlternativeModel:
    """A polynomial in time."""
    return AlternativeModel(rms(left_over(polynomials(np.linspace(-1.0, 1.0, v.size), 5), v)))


def channels(u: Vector, v: Vector, look: int) -> AlternativeModel:
    """One cubic for even samples and one for odd ones, over ``look`` samples spread in pairs; not where one for all
    does nearly as well."""
    even = 2 * np.arange(0, u.size // 2, max(1, u.size // look))
    if min(np.unique(u[even + i]).size for i in (0, 1)) <= 4:  # through four points goes a cubic, whatever they are
        return AlternativeModel(np.inf)
    columns, values = [polynomials(2 * u[even + i] - 1, 3) for i in (0, 1)], [v[even + i] for i in (0, 1)]
    apart = rms(np.concatenate([left_over(*each) for each in zip(columns, values, strict=True)]))
    together = rms(left_over(np.vstack(columns), np.concatenate(values)))
    return AlternativeModel(apart if apart < APART * together and together > ROUNDING else np.inf)


def butterfly(u: Vector, v: Vector) -> AlternativeModel:
    """A curve that goes down and up for each direction of the drive."""
    direction = np.sign(np.gradient(np.convolve(u, np.ones(5) / 5, "same")))
    if abs(rise(u, v)) > 0.7:
        return AlternativeModel(np.inf)
    columns = polynomials(2 * u - 1, 6)
    return AlternativeModel(rms(left_over(np.hstack([columns, columns * direction[:, None]]), v)))


def backlash(u: Vector, v: Vector) -> AlternativeModel:
    """A straight line in one play, and nothing of the drive beside it; ``found`` is the play's width as a share of the
    drive's range. At the start it touches either side or stands in the middle."""
    found = AlternativeModel(np.inf)
    for side in (-1.0, 0.0, 1.0):
        z = play(u, RADII, u[0] + side * RADII)[0]
        z -= z.mean(axis=0)
        left = np.mean(v**2) - np.square(v @ z / v.size) / np.maximum(np.mean(z**2, axis=0), ROUNDING)
        k = int(np.argmin(left))
        found = min(found, AlternativeModel(float(np.sqrt(max(left[k], 0.0))), 2.0 * float(RADII[k])))
    return found


def tones(u: Vector, most: int = 1) -> bool:
    """Whether nearly all of the drive's power is in so many tones and their neighbours."""
    power = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(u.size))) ** 2
    total = power.sum()
    for _ in range(most):
        top = int(np.argmax(power))
        power[max(top - 2, 0) : top + 3] = 0.0
    return bool(power.sum() < (1.0 - PURE) * total)


def phase(u: Vector, v: Vector) -> AlternativeModel:
    """By how many degrees the output lags at the drive's strongest tone, which is ``found`` in cycles a sample, in
    place of an error."""
    U, V = (np.fft.rfft((each - each.mean()) * np.hanning(u.size)) for each in (u, v))
    top = int(np.argmax(np.abs(U)))
    return AlternativeModel(float(np.degrees(np.angle(U[top] / V[top]))), top / u.size)


def delay(u: Vector, v: Vector) -> AlternativeModel:
    """A cubic in the drive of ``found`` samples before, up to a quarter of the recording."""
    longest = min(u.size // 4, 2000)
    if tones(u):
        return AlternativeModel(np.inf)

    def error(late: int) -> float:
        return rms(left_over(polynomials(2 * u[longest - late : u.size - late] - 1, 3), v[longest:]))

    tried = np.unique(np.geomspace(1, max(longest, 1), 40).astype(int))
    best = int(np.argmin([error(int(late)) for late in tried]))
    near = np.unique(np.linspace(tried[max(best - 1, 0)], tried[min(best + 1, tried.size - 1)], 40).astype(int))
    errors = [error(int(late)) for late in near]
    return AlternativeModel(min(errors), float(near[int(np.argmin(errors))]))


def resonance(u: Vector, v: Vector) -> AlternativeModel:
    """Two conjugate poles; ``found`` is the frequency in cycles a sample. Two tones determine no zeros."""
    if tones(u):
        return AlternativeModel(np.inf)
    delays = (1,) if tones(u, 2) else range(3)
    u = u - u[0]

    def error(at: Vector) -> float:
        rho, phi = 1.0 / (1.0 + np.exp(-at[0])), np.exp(at[1])
        poles = [1.0, -2.0 * rho * np.cos(phi), rho * rho]
        columns = [lfilter([0.0] * late + [1.0], poles, u) for late in delays]
        return rms(
            left_over(
                np.column_stack([*(column / (np.linalg.norm(column) or 1.0) for column in columns), np.ones_like(u)]), v
            )
        )

    grid = [
        np.array([np.log(rho / (1.0 - rho)), np.log(phi)])
        for rho in (0.8, 0.95, 0.99)
        for phi in np.geomspace(0.01, 2.5, 14)
    ]
    best = minimize(error, min(grid, key=error), method="Nelder-Mead", options={"maxfev": 80})
    rho, phi = 1.0 / (1.0 + np.exp(-best.x[0])), float(np.exp(best.x[1]))
    damping = -np.log(rho) / np.hypot(np.log(rho), phi)
    return AlternativeModel(
        float(best.fun) if DAMPING[0] < damping < DAMPING[1] and phi < np.pi else np.inf, phi / (2.0 * np.pi)
    )
