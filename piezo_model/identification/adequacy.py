"""Whether a model of hysteresis and creep is adequate for a recording.

It is refused if it errs nearly as much as a line, unless the rest is noise about an output that follows the drive.

A refusal is one sentence. An outlier of the output, an output that falls and rises again, and a drive whose turning
points lie between its samples are named. Data on a curve have no hysteresis, and if the fit is no better than the line,
the line is the model, since noise in the output biases the slope of (6) and not that of the line.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from piezo_model.identification.error_model import Solving
from piezo_model.identification.fit_errors import Baseline, Fit, cross_validate, residual, rms
from piezo_model.identification.forward import ForwardFit
from piezo_model.identification.start import HEAD, first_motion
from piezo_model.recordings import Recording
from piezo_model.units import percent, quantity
from solvers.arrays import Matrix, Vector

WINDOW = 12_000
"""Samples, spread over the recording, to which a curve is fitted."""
KNOTS = 24
"""Knots of a piecewise linear curve."""
SMOOTH = 9
"""Degree of the polynomials of a smooth curve."""
NO_BETTER, IGNORED, UNDERSAMPLED = 0.7, 0.9, 0.5
"""Largest ratio of a model's error to the line's at which the model is better (half of the squares are left), that if
dynamics are ignored on purpose, and that for an undersampled drive."""
EXACT = 1e-5
"""Largest error of data that lie exactly on a curve, as a share of the range."""
LOOPS = 0.99
"""Largest ratio of the error of a model to that of a curve at which there are loops in the noise."""
WHITE = 0.4
"""Largest correlation of neighbouring samples in noise."""
FOLLOWS = 0.75
"""Largest ratio of the line's error to the output's deviation at which the output follows the drive."""
ROUGH = 0.3
"""1 − correlation of neighbouring samples of a drive of about eight samples a period."""
ONE_WAY = 0.9
"""Smallest share of the drive's travel in one direction that counts as a single branch."""
STRIDE, FOLDED = 0.1, 0.7
"""Movement of the drive, and largest ratio of net change to total variation of an output that falls and rises again."""
POOR = 0.06
"""Smallest error of a model, as a share of the range, of an output that does."""
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
    monotonic_drive: bool
    """Whether the data are nearly a single branch."""
    spikes: int
    """Samples of the output that lie far from both neighbours and from the model, on one side."""
    spike_percent: float
    """The largest distance of one from its neighbours, per cent of the range."""


def check_adequacy(
    recording: Recording, fitted: ForwardFit, skip: int, solving: Solving, fit: Fit, *, dynamics_ignored: bool = False
) -> Adequacy:
    """Compare a fit with a line, and the recording with a curve."""
    s = fitted.structure
    # with many samples and few weights, the error of the fit is near that on held-out data
    held_out = cross_validate(recording, fitted, skip, solving, fit.span) if recording.length <= HEAD else None
    baseline = held_out or Baseline(fit.line_percent, fit.cubic_percent, fit.rms_percent, held_out=False)
    counted = slice(skip, HEAD + first_motion(recording, skip))
    u, v = s.unit_input(recording.x[counted]), recording.y[counted] / fit.span
    own = v - (s.y_centre + s.y_scale * fitted.y_model[counted]) / fit.span
    error, line = baseline.model_percent / 100.0, baseline.line_percent / 100.0
    thinned = slice(None, None, math.ceil(u.size / WINDOW))
    off_curve = residual(curves(u), v, thinned)
    curve = rms(off_curve)
    scattered = curve < EXACT or correlation(off_curve) < WHITE
    hidden = curve < EXACT or error > LOOPS * curve  # loops much smaller than the noise still lower the error
    on_curve = scattered and hidden and curve < 1.2 * error + EXACT and line < 0.8 * float(v.std())
    noise = correlation(own) < WHITE and line < FOLLOWS * float(v.std())
    refusal, no_better = outlier(recording, counted, s.output_unit), IGNORED if dynamics_ignored else NO_BETTER
    period = 2.0 * math.pi / math.acos(1.0 - min(max(roughness(u), ROUGH), 2.0))
    reasons = {
        f"the drive is undersampled, with {period:.1f} samples a period, or aliased, so that its turning points, "
        "on which hysteresis depends, are lost": is_undersampled(u) and error > UNDERSAMPLED * line,
        "the output falls and rises again on one way of the drive, as the butterfly of a strain over a field, "
        "or as an output that is late": (
            error > POOR and is_folded(u[thinned], v[thinned]) and roughness(v) < ROUGH and not noise
        ),
        "the model class does not describe these data": error > no_better * line and not noise,
    }
    if refusal is None and not on_curve and any(reasons.values()):
        reason = next(why for why, applies in reasons.items() if applies)
        own_error = f"{percent(100.0 * error)} with this model" if error < line else "and this model is no better"
        refusal = f"{reason}: RMS residual {percent(100.0 * line)} of range with a straight line, {own_error}"
    on_curve = on_curve and refusal is None
    apart = np.minimum(_apart(v), _apart(own))
    spikes = apart[apart > max(SPIKE, FAR * float(np.quantile(apart, RARE)))]
    largest = 100.0 * float(spikes.max(initial=0.0))
    return Adequacy(
        baseline, not on_curve, on_curve and not baseline.is_significant, refusal, is_monotonic(u), spikes.size, largest
    )


def _apart(v: Vector) -> Vector:
    """Distances of samples from the nearer one of their neighbours, 0 if those lie on both sides."""
    before, after = v[1:-1] - v[:-2], v[1:-1] - v[2:]
    return np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)


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


def is_folded(u: Vector, v: Vector) -> bool:
    """Whether an output (N,) both rises and falls where the drive has moved on by a share of its range, STRIDE."""
    travel = np.cumsum(np.abs(np.diff(u, prepend=u[0]))) / np.ptp(u)
    at = np.searchsorted(travel, np.arange(0.0, travel[-1], STRIDE))
    moved = np.diff(u[at]) * np.diff(v[at])
    return abs(float(moved.sum())) < FOLDED * float(np.abs(moved).sum())


def correlation(error: Vector) -> float:
    """Correlation of neighbouring samples, positive or negative: 0 for white noise, 1 for a slow signal."""
    e = error - error.mean()
    return abs(float(e[1:] @ e[:-1] / max(e @ e, 1e-300)))


def curves(u: Vector) -> Matrix:
    """Functions of −1 ≤ u ≤ 1 of which a curve is a combination: piecewise linear ones over knots with equally many
    samples between them, and polynomials where it is smooth and without noise."""
    at = np.unique(np.quantile(u, np.linspace(0.0, 1.0, KNOTS)))
    return np.column_stack([*(np.interp(u, at, row) for row in np.eye(at.size)), chebvander(u, SMOOTH)])


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
