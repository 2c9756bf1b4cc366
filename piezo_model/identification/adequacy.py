"""The errors of a model, compared with those of a line and a cubic, and whether the model is adequate.

It is refused if its error exceeds NO_BETTER of a line's and USEFUL of the output's deviation, unless what it leaves is
white and smaller than the output: loops in noise, or a line. As its d weights are fitted to the N samples, the error of
the next ones is larger by √((N + d) / (N − d)). An outlier of the output, a drive whose turning points lie between its
samples, and an output that falls and rises again are refused by their names. A refusal is one sentence.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from piezo_model.identification.error_model import counted_from, percent_of
from piezo_model.identification.faults import NOTABLE, TINY, Signals, faults_of, residual, unexplained
from piezo_model.identification.forward import ForwardFit
from piezo_model.identification.start import HEAD, first_motion
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from piezo_model.units import LENGTHS, SMALLEST_PERCENT, VOLTAGES, percent, quantity
from solvers.arrays import Vector

NO_BETTER, IGNORED, UNDERSAMPLED, LOOPS, USEFUL = 0.6, 0.92, 0.5, 0.99, 0.05
"""Largest ratio of a model's error to the line's at which the model is better (it explains two thirds of the squares),
that if dynamics are ignored on purpose, that for an undersampled drive, and that at which there are loops in noise;
largest ratio of a model's error to the output's deviation at which it is useful although a line is as good."""
WHITE, FOLLOWS = 0.4, 0.75
"""Largest correlation of neighbouring samples in noise; largest ratio of the line's error to the output's deviation at
which the output follows the drive."""
ROUGH, COVERED = 0.3, 0.3
"""1 − correlation of neighbouring samples of a drive of about eight samples a period; smallest share of the drive's
range that more than a single branch crosses both ways: small loops at one end say nothing of those over the whole."""
TURNS, CURVED, OPPOSITE, POOR, OUTLYING = 0.02, 0.15, 0.1, 0.06, 10.0
"""Of an output that falls and rises again: smallest error of a model, as a share of the range, share of a parabola in
the variance, and ratio of opposite slopes; smallest error if the output is no parabola; smallest ratio of an outlier's
distance from the median to that of any other sample."""
BASELINE_SAMPLES = 1_000_000
"""Most samples, spread over the recording, to which a line and a cubic are fitted."""


@dataclass(frozen=True)
class Fit:
    """The output error of a model over a recording."""

    samples: int
    """Number of counted samples."""
    skipped: int
    """Number of first samples that are not counted."""
    rms_percent: float
    max_percent: float
    """Errors of the counted samples, % of the output's full range."""
    rms: float
    max: float
    """The same errors in the output's unit."""
    skipped_max_percent: float
    """Largest error of the skipped samples."""
    line_percent: float
    cubic_percent: float
    """RMS errors of the best line and the best cubic over the counted samples."""
    span: float
    """The output's full range without a transient, in its unit."""
    missing: int
    """Number of samples after the skipped ones that are not counted, since their output is missing."""

    def headline(self, unit: str, where: str = "") -> str:
        """The errors in one sentence."""
        total = self.samples + self.skipped + self.missing
        every = f" of {total}" if total > self.samples else ""
        without = f" ({self.missing} not counted)" if self.missing else ""
        unknown = "" if unit else ", unit unknown"
        largest = f" ({quantity(self.max, unit, 2)}{unknown})" if self.max_percent >= SMALLEST_PERCENT else ""
        return (
            f"RMS error {percent(self.rms_percent)} of the output's range with this model{where and ' ' + where}, "
            f"{percent(self.line_percent)} with a straight line, over {self.samples}{every} samples{without}; "
            f"largest error {percent(self.max_percent)}{largest}."
        )


def rms(error: Vector) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(error**2)))


def fit_of(recording: Recording, s: ModelStructure, errors: Vector, skipped: int, span: float) -> Fit:
    """The `Fit` of errors (N,), without the first ``skipped`` samples."""
    counted = counted_from(recording, skipped)
    error, x, y = errors[counted], recording.x[counted], recording.y[counted]
    stride = math.ceil(x.size / BASELINE_SAMPLES)
    u, v = s.unit_input(x[::stride]), s.unit_output(y[::stride])
    line, cubic = (abs(s.y_scale) * rms(residual(chebvander(u, degree), v)) for degree in (1, 3))
    deviation, largest = rms(error), float(np.max(np.abs(error)))
    return Fit(
        samples=error.size,
        skipped=skipped,
        rms_percent=percent_of(span, deviation),
        max_percent=percent_of(span, largest),
        rms=deviation,
        max=largest,
        skipped_max_percent=percent_of(span, float(np.max(np.abs(errors[:skipped]), initial=0.0))),
        line_percent=percent_of(span, line),
        cubic_percent=percent_of(span, cubic),
        span=span,
        missing=recording.length - skipped - error.size,
    )


@dataclass(frozen=True)
class Adequacy:
    """The verdict on a fit."""

    refusal: str | None
    """The reason against the model, one sentence without its full stop."""
    monotonic_drive: bool
    """Whether the data are nearly a single branch."""
    faults: Sequence[str]
    """What the recording shows of faults of the bench, in sentences."""


def check_adequacy(recording: Recording, fitted: ForwardFit, skip: int, fit: Fit, dynamics_ignored: bool) -> Adequacy:
    """Compare a fit with a line, and look for faults, beside which a butterfly has no name. An output that is not
    counted is that of the model."""
    s, counted = fitted.structure, slice(skip, HEAD + first_motion(recording, skip))
    y_model = s.y_centre + s.y_scale * fitted.y_model
    recording = replace(recording, y=np.where(recording.uncounted, y_model, recording.y))
    signals = Signals.of(recording, y_model, skip, math.copysign(fit.span, s.y_scale))
    faults = faults_of(signals)
    u, v = s.unit_input(recording.x[counted]), recording.y[counted] / fit.span
    free, deviation = int(np.count_nonzero(fitted.free)), float(v.std())
    expected = fit.rms_percent * math.sqrt((fit.samples + free) / max(1, fit.samples - free))
    error, line = (percents / 100.0 for percents in (expected, fit.line_percent))
    noise = (
        line < FOLLOWS * deviation
        and LOOPS * fit.rms_percent <= 100.0 * line
        and abs(1.0 - roughness(v - y_model[counted] / fit.span)) < WHITE
    )
    period = 2.0 * math.pi / math.acos(1.0 - min(max(roughness(u), ROUGH), 2.0))
    reasons = applicable(
        (
            roughness(u) > ROUGH
            and error > UNDERSAMPLED * line > UNDERSAMPLED * NOTABLE
            and not (noise and error > LOOPS * line),
            f"the drive is undersampled, with {period:.1f} samples a period, or aliased, so that its turning points, "
            "on which hysteresis depends, are lost",
        ),
        (
            not faults and error > TURNS and falls_and_rises(signals, error),
            "the output falls and rises again on one way of the drive, as the butterfly of a strain over a field does, "
            "or an output that rings or is late",
        ),
        (
            not noise and error > max((IGNORED if dynamics_ignored else NO_BETTER) * line, USEFUL * deviation),
            "the model class does not describe these data",
        ),
    )
    refusal, reason = outlier(recording, counted, s.output_unit), next(reasons, None)
    if refusal is None and reason is not None:
        own_error = f"{percent(100.0 * error)} with this model" if error < line else "and this model is no better"
        refusal = f"{reason}: RMS residual {percent(100.0 * line)} of range with a straight line, {own_error}" + (
            "; the input is a length and the output a voltage, as if they were swapped"
            if s.input_unit in LENGTHS and s.output_unit in VOLTAGES
            else ""
        )
    if not (faults or refusal) and (left := unexplained(signals)):
        faults = [left]
    return Adequacy(refusal, is_monotonic(u), faults)


def applicable(*sentences: tuple[object, object]) -> Iterator[str]:
    """The sentences, each behind its condition, of which the condition holds."""
    return (str(sentence) for applies, sentence in sentences if applies)


def falls_and_rises(s: Signals, error: float) -> bool:
    """Whether an output, of whose range a model has an ``error`` above TURNS, falls and rises again on one way of the
    drive: its slopes in the outer thirds of the drive's range have opposite signs, and a parabola explains a good share
    of the variance that a line leaves, while saturation ends at a slope of 0, and ringing and noise have no part in a
    parabola. Of a wide butterfly, which is no parabola either, it is only known that it is smooth and does not follow
    the drive."""
    first, last = (
        covariance / max(variance, TINY)
        for (variance, covariance), _ in (np.cov(s.u[at], s.v[at], bias=True) for at in (s.u < 1 / 3, s.u > 2 / 3))
    )
    whole, line, parabola = (residual(chebvander(s.u, degree), s.v).var() for degree in range(3))
    return bool(
        (line - parabola > CURVED * whole and -first * last > OPPOSITE * max(first**2, last**2))
        or (error > POOR and line > FOLLOWS**2 * whole and roughness(s.v) < ROUGH)
    )


def is_monotonic(x: Vector) -> bool:
    """Whether a drive (N,) is nearly a single branch: it never crosses a share of its range, COVERED, both ways, or
    has its samples of one way nearly in one place, as a sawtooth.

    Examples
    --------
    >>> swing = np.sin(np.linspace(0.0, 60.0, 3000))
    >>> is_monotonic(swing), is_monotonic(np.concatenate([np.linspace(-1.0, 1.0, 3000), 1.0 - 0.1 * swing]))
    (False, True)
    >>> is_monotonic(np.arange(3000) % 100)
    True
    """
    falls = np.diff(x, prepend=x[:1]) < 0.0
    reached = (
        *(np.max(way - np.minimum.accumulate(way)) for way in (x, -x)),
        np.ptp(x[falls]) if falls.any() else 0.0,
        np.ptp(x[~falls]),
    )
    return bool(min(reached) < COVERED * np.ptp(x))


def roughness(u: Vector) -> float:
    """1 − correlation of neighbouring samples: 1 for white noise, 1 − cos(2π/p) for a sine of p samples a period."""
    return float(np.mean(np.diff(u) ** 2) / max(2.0 * u.var(), 1e-300))


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
