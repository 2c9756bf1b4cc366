"""Whether a model of hysteresis and creep is adequate for a recording, by few means.

    line, cubic   the model errs nearly as much as a line, or twice as much as a cubic: the model class does not fit
    resonance     v = b(z) / (1 − 2ρ cos φ z⁻¹ + ρ² z⁻²) u errs far less than model and cubic
    delay         a cubic in the drive some samples ago errs far less
    drift         a polynomial in time errs far less
    outlier       one output is far from all others

A refusal is one sentence that names the explanation; a resonance is no reason for one if dynamics are ignored on
purpose. Data on a curve with noise are not refused: they have no
hysteresis, and if the fit is no better than the line, the line is the model, since noise in the output biases the slope
of (6) and not that of the line.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from scipy.optimize import minimize
from scipy.signal import lfilter

from piezo_model.dynamics import HIGHEST
from piezo_model.identification.error_model import Solving
from piezo_model.identification.fit_errors import Baseline, Fit, cross_validate, residual, rms
from piezo_model.identification.forward import ForwardFit
from piezo_model.identification.start import HEAD
from piezo_model.identification.transient import first_motion
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from piezo_model.units import percent, quantity
from solvers.arrays import Matrix, Vector

WINDOW = 12_000
"""Samples, consecutive or spread over the recording, to which other explanations are fitted."""
KNOTS = 24
"""Knots of a piecewise linear curve."""
SMOOTH = 9
"""Degree of the polynomials of a smooth curve."""
MUCH_BETTER = 0.5
"""Largest ratio of another explanation's error to the model's that counts as better."""
HARDLY_BETTER = 0.7
"""Smallest ratio of the model's error to the line's at which the model class does not fit unless the error is noise:
half of the line's squares are left."""
NO_BETTER = 0.9
"""The same of a model whose dynamics are ignored on purpose, and of other explanations."""
GOOD = 1e-3
"""Error, as a share of the range, below which a model needs no alternative if it also halves that of a line."""
EXACT = 1e-5
"""Largest error of data that lie exactly on a curve, as a share of the range."""
LOOPS = 0.99
"""Largest ratio of the error of a model to that of a curve at which there are loops in the noise."""
WHITE = 0.4
"""Largest correlation of neighbouring samples in noise."""
NOISY = 0.02
"""Smallest error of a curve, as a share of the range, that may be a resonance instead of noise."""
ROUGH = 0.3
"""1 − correlation of neighbouring samples of a drive of about eight samples a period."""
ONE_WAY = 0.9
"""Smallest share of the drive's travel in one direction that counts as a single branch."""
STRIDE, FOLDED = 0.1, 0.7
"""Movement of the drive, and largest ratio of net change to total variation of an output that falls and rises again."""
POOR = 0.06
"""Smallest error of a model, as a share of the range, of an output that does."""
PURE = 0.9
"""Smallest share of the drive's power in one tone at which resonance and hysteresis cannot be distinguished."""
DAMPING = (0.003, 0.7)
"""Range of a resonance's damping ratio."""
SPIKE = 0.05
"""Smallest spike that is worth a sentence, as a share of the range."""
RARE = 0.99
"""Quantile of the samples' distances from their neighbours beyond which lie spikes,"""
FAR = 4.0
"""and the smallest multiple of it at which they do; those of a million normal errors reach three times."""
OUTLYING = 10.0
"""Smallest ratio of an outlier's distance from the median to that of any other sample."""


@dataclass(frozen=True)
class Adequacy:
    """The verdict on a fit."""

    baseline: Baseline
    hysteresis: bool
    straight: bool
    """Whether a line is as good as the model."""
    refusal: str | None
    """The reason against the model, one sentence without its full stop."""
    left_out: str | None
    """The resonance that the output has, in place of a refusal, if dynamics are ignored; a sentence likewise."""
    monotonic_drive: bool
    """Whether the data are nearly a single branch."""
    spikes: int
    """Samples of the output that lie far from both neighbours and from the model, on one side."""
    spike_percent: float
    """The largest distance of one from its neighbours, per cent of the range."""


def check_adequacy(
    recording: Recording, fitted: ForwardFit, skip: int, solving: Solving, fit: Fit, *, dynamics_ignored: bool = False
) -> Adequacy:
    """Compare a fit with a line, a cubic and other explanations of the recording."""
    s = fitted.structure
    # with many samples and few weights, the error of the fit is near that on held-out data
    held_out = cross_validate(recording, fitted, skip, solving, fit.span) if recording.length <= HEAD else None
    baseline = held_out or Baseline(fit.line_percent, fit.cubic_percent, fit.rms_percent, held_out=False)
    counted = slice(skip, HEAD + first_motion(recording, skip))
    x, y = recording.x[counted], recording.y[counted]
    own = (y - s.y_centre - s.y_scale * fitted.y_model[counted]) / fit.span
    data = _Data(0.5 + 0.5 * s.unit_input(x), (y - y.mean()) / fit.span, own)
    error, line = baseline.model_percent / 100.0, baseline.line_percent / 100.0
    curve = rms(residual(curves(data.thin_u), data.thin_v))
    scattered = curve < EXACT or correlation(residual(curves(data.near_u), data.near_v)) < WHITE
    hidden = curve < EXACT or error > LOOPS * curve  # loops much smaller than the noise still lower the error
    on_curve = scattered and hidden and curve < 1.2 * error + EXACT and line < 0.8 * float(data.v.std())
    own_error = f"{percent(100.0 * error)} with this model" if error < line else "and this model is no better"
    compared = f"RMS residual {percent(100.0 * line)} of range with a straight line, {own_error}"
    poor = error > MUCH_BETTER * line
    good = error < GOOD and not poor
    refusal, left_out = outlier(recording, counted, s.output_unit), None
    if refusal is None and not good and (not on_curve or curve > NOISY):
        refusal, resonant = _late(data, s, poor, compared)
        if resonant and dynamics_ignored:
            refusal, left_out = None, refusal
    unexplained = left_out is None and not on_curve
    if refusal is None and unexplained and not good:
        no_better = error >= (NO_BETTER if dynamics_ignored else HARDLY_BETTER) * line
        refusal = _mismatch(data, error, line, no_better, fit, compared)
    on_curve = on_curve and refusal is None and left_out is None
    straight = on_curve and not baseline.is_significant
    apart = np.minimum(_apart(data.v), _apart(own))
    spikes = apart[apart > max(SPIKE, FAR * float(np.quantile(apart, RARE)))]
    largest = 100.0 * float(spikes.max(initial=0.0))
    return Adequacy(
        baseline, not on_curve, straight, refusal, left_out, is_monotonic(data.thin_u), spikes.size, largest
    )


def _apart(v: Vector) -> Vector:
    """Distances of samples from the nearer one of their neighbours, 0 if those lie on both sides."""
    before, after = v[1:-1] - v[:-2], v[1:-1] - v[2:]
    return np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)


class _Data:
    """Drive and output (N,) as shares of their ranges: all of them, a thinned set, and the window where the model errs
    most."""

    def __init__(self, u: Vector, v: Vector, own: Vector) -> None:
        energy, thinned = np.concatenate([[0.0], np.cumsum(own**2)]), slice(None, None, math.ceil(u.size / WINDOW))
        first = int(np.argmax(energy[WINDOW:] - energy[:-WINDOW])) if u.size > WINDOW else 0
        near = slice(first, first + WINDOW)
        self.v, self.thin_u, self.thin_v = v, u[thinned], v[thinned]
        self.near_u, self.near_v, self.near_own = u[near], v[near], own[near]

    @property
    def is_folded(self) -> bool:
        """Whether the output both rises and falls where the drive has moved on by a share of its range, STRIDE."""
        travel = np.cumsum(np.abs(np.diff(self.thin_u, prepend=self.thin_u[0])))
        at = np.searchsorted(travel, np.arange(0.0, travel[-1], STRIDE))
        moved = np.diff(self.thin_u[at]) * np.diff(self.thin_v[at])
        return abs(float(moved.sum())) < FOLDED * float(np.abs(moved).sum())


def is_monotonic(x: Vector) -> bool:
    """Whether a drive (N,) is nearly a single branch."""
    travel = np.diff(x)
    up, down = float(travel[travel > 0].sum()), -float(travel[travel < 0].sum())
    return max(up, down) > ONE_WAY * max(up + down, 1e-300)


def roughness(u: Vector) -> float:
    """1 − correlation of neighbouring samples; 1 − cos(2π/p) for a sine of p samples a period."""
    return float(np.mean(np.diff(u) ** 2) / max(2.0 * u.var(), 1e-300))


def is_undersampled(u: Vector) -> bool:
    """Whether the turning points of a drive (N,) lie between its samples."""
    return roughness(u) > ROUGH


def _late(data: _Data, s: ModelStructure, poor: bool, compared: str) -> tuple[str | None, bool]:
    """The reason against a model that a resonance, a delay or a lack of samples gives, None without one, and whether it
    is a resonance."""
    u, v = data.near_u, data.near_v
    cubic = rms(residual(chebvander(2.0 * u - 1.0, 3), v))
    far_better = MUCH_BETTER * min(rms(data.near_own), cubic)
    (resonant, frequency), (delayed, delay) = resonance(u, v), delay_of(u, v)
    if resonant < min(far_better, delayed):
        fast = f", above {HIGHEST:.0%} of the sampling rate; record faster".replace("%", " %") * (frequency > HIGHEST)
        return f"the output has a resonance at {quantity(frequency / s.sample_time, 'Hz', 3)}{fast}: {compared}", True
    if delayed < far_better:
        return f"the output is the drive with a delay of {quantity(delay * s.sample_time, 's', 3)}: {compared}", False
    if not (poor and is_undersampled(u)):
        return None, False
    period = 2.0 * math.pi / math.acos(max(1.0 - roughness(u), -1.0))
    return (
        f"the drive is undersampled, with {period:.1f} samples a period, or aliased: its turning points, on which "
        f"hysteresis depends, are lost; {compared}"
    ), False


def _mismatch(data: _Data, error: float, line: float, no_better: bool, fit: Fit, compared: str) -> str | None:
    """The reason against a model that errs as much as a line, a cubic, or a trend in time; None without one."""
    cubic = fit.cubic_percent / 100.0
    drifts = fit.rms_percent >= NO_BETTER * fit.line_percent  # with a drift that the model leaves out
    trend = rms(residual(chebvander(np.linspace(-1.0, 1.0, data.thin_v.size), 5), data.thin_v))
    follows = line <= NO_BETTER * float(data.v.std())
    left = correlation(data.near_own) > WHITE or not follows  # more than the sensor's noise
    reasons = (
        (
            drifts and trend < MUCH_BETTER * min(error, cubic),
            f"the output drifts with time and does not follow the drive: RMS residual {percent(100.0 * trend)} of "
            f"range with a polynomial in time, {compared.removeprefix('RMS residual ')}",
        ),
        (
            no_better and correlation(data.near_v) < WHITE and not follows,
            f"the output is noise that does not follow the drive: {compared}",
        ),
        (
            error > POOR and data.is_folded and roughness(data.near_v) < ROUGH,
            "the output falls and rises again on one way of the drive, as the butterfly of a strain over a field: "
            f"{compared}, {percent(100.0 * cubic)} with a cubic",
        ),
        (
            (no_better and left) or cubic < MUCH_BETTER * error,
            f"the model class does not describe these data: {compared}, {percent(100.0 * cubic)} with a cubic",
        ),
    )
    return next((reason for applies, reason in reasons if applies), None)


def correlation(error: Vector) -> float:
    """Correlation of neighbouring samples, positive or negative: 0 for white noise, 1 for a slow signal."""
    e = error - error.mean()
    return abs(float(e[1:] @ e[:-1] / max(e @ e, 1e-300)))


def hats(u: Vector) -> Matrix:
    """Piecewise linear functions of u over knots with equally many samples between them, shape (N, ≤ KNOTS)."""
    at = np.unique(np.quantile(u, np.linspace(0.0, 1.0, KNOTS)))
    return np.column_stack([np.interp(u, at, row) for row in np.eye(at.size)])


def curves(u: Vector) -> Matrix:
    """Functions of 0 ≤ u ≤ 1 of which a curve is a combination: piecewise linear ones, and polynomials where it is
    smooth and without noise."""
    return np.hstack([hats(u), chebvander(2.0 * u - 1.0, SMOOTH)])


def outlier(recording: Recording, samples: slice, unit: str) -> str | None:
    """A clause about a single outlier of the output that is none of the drive; None without one."""
    y = recording.y[samples]
    at = _outlying(y)
    if at is None or at == _outlying(recording.x[samples]):
        return None
    others = np.delete(y, at)
    lowest, highest = (quantity(float(end), unit) for end in (others.min(), others.max()))
    return (
        f"the output is {quantity(float(y[at]), unit)} in sample {(samples.start or 0) + at}, and from {lowest} to "
        f"{highest} in all others: an outlier"
    )


def _outlying(v: Vector) -> int | None:
    """Index of a single outlier; None without one."""
    distance = np.abs(v - np.median(v))
    at = int(np.argmax(distance))
    return at if distance[at] > OUTLYING * np.max(np.delete(distance, at), initial=0.0) else None


def is_tonal(u: Vector, tones: int = 1) -> bool:
    """Whether nearly all of the drive's power is in a number of tones."""
    power = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(u.size))) ** 2
    total = power.sum()
    for _ in range(tones):
        top = int(np.argmax(power))
        power[max(top - 2, 0) : top + 3] = 0.0
    return bool(power.sum() < (1.0 - PURE) * total)


def delay_of(u: Vector, v: Vector) -> tuple[float, int]:
    """RMS error of a cubic in the delayed drive, infinite for one tone, and the delay in samples, up to a quarter of
    the recording."""
    longest = min(u.size // 4, 2000)
    if is_tonal(u):
        return math.inf, 0

    def error(samples: int) -> float:
        return rms(residual(chebvander(2.0 * u[longest - samples : u.size - samples] - 1.0, 3), v[longest:]))

    coarse = np.unique(np.geomspace(1, max(longest, 1), 40).astype(int)).tolist()
    best = coarse.index(min(coarse, key=error))
    fine = np.linspace(coarse[max(best - 1, 0)], coarse[min(best + 1, len(coarse) - 1)], 40).astype(int)
    return min((error(samples), samples) for samples in np.unique(fine).tolist())


def resonance(u: Vector, v: Vector) -> tuple[float, float]:
    """RMS error of two conjugate poles, infinite if they do not apply, and their frequency in cycles per sample. Two
    tones determine no zeros, and one tone no resonance."""
    if is_tonal(u):
        return math.inf, 0.0
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
    applies = DAMPING[0] < damping < DAMPING[1] and phi < np.pi
    return float(best.fun) if applies else math.inf, phi / (2.0 * np.pi)
