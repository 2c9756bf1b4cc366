"""The errors of a model, compared with those of a line and a cubic."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from piezo_model.identification.error_model import counted_from, percent_of
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from piezo_model.units import SMALLEST_PERCENT, percent, quantity
from solvers.arrays import Vector

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


def residual(columns: np.ndarray, v: Vector) -> Vector:
    """Residual (N,) of v (N,) for the best combination of the columns (N, p)."""
    return np.asarray(v - columns @ np.linalg.lstsq(columns, v, rcond=None)[0])


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
