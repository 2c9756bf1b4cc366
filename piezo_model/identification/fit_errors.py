"""The errors of a model beside those of a line and a cubic, on the data of the fit and on held-out data.

For held-out data the drive of each part is cut into blocks of equal travel, up or down, or of equal time at rest, so
that every branch of every loop has several blocks and one loop is enough. Line, cubic and model are fitted to every
second block and judged on the others, and vice versa; the operators of the model run through all blocks, and its fit
begins with that to all of them.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from piezo_model.identification.dynamics_parameters import Parameters
from piezo_model.identification.error_model import Solving, counted_from, percent_of
from piezo_model.identification.forward import ForwardFit, fit_forward
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from piezo_model.units import SMALLEST_PERCENT, percent, quantity
from solvers.arrays import Mask, Vector

BASELINE_SAMPLES = 1_000_000
"""Samples, spread over a longer recording, to which a line and a cubic are fitted."""
BLOCKS = 16
"""Blocks for one traverse of the range, up to about MOST_BLOCKS in all."""
FEWEST_BLOCKS, MOST_BLOCKS = 64, 2000
STEPS = 2
"""Gauss–Newton steps from the fit to all blocks to that of every second one."""


@dataclass(frozen=True)
class Fit:
    """Error of the forward model."""

    samples: int
    """Number of counted samples."""
    skipped: int
    """Number of samples before them."""
    rms_percent: float
    max_percent: float
    """Errors of the counted samples, per cent of the output's full range."""
    rms: float
    max: float
    """The same in the output's unit."""
    skipped_max_percent: float
    """Largest error of the skipped samples."""
    line_percent: float
    cubic_percent: float
    """RMS errors of the best line and the best cubic over the counted samples."""
    line: tuple[float, float]
    """Constant and slope of the best line, normalised units."""
    span: float
    """The output's full range without a transient, in its unit."""
    missing: int
    """Number of samples after the skipped ones without an output, which are not counted."""

    def headline(self, unit: str, where: str = "") -> str:
        """The errors in one sentence."""
        total = self.samples + self.skipped + self.missing
        every = f" of {total}" if total > self.samples else ""
        without = f" ({self.missing} not counted)" if self.missing else ""
        unknown = "" if unit else " in the unit of the output, which the file does not say"
        largest = f" ({quantity(self.max, unit, 2)}{unknown})" if self.max_percent >= SMALLEST_PERCENT else ""
        return (
            f"{percent(self.line_percent)} with a line, {percent(self.rms_percent)} with this "
            f"model{where and ' ' + where}: RMS error of the output as a share of its full range, "
            f"over {self.samples}{every} samples{without}; the largest error is {percent(self.max_percent)}{largest}."
        )


@dataclass(frozen=True)
class Baseline:
    """RMS errors of the output, per cent of its full range."""

    line_percent: float
    cubic_percent: float
    model_percent: float
    held_out: bool
    """Whether they are those on held-out data, and not on the data of the fits."""

    @property
    def is_significant(self) -> bool:
        """Whether the model is better than the line."""
        return self.model_percent < 0.9 * self.line_percent

    @property
    def sentence(self) -> str:
        """The errors in words."""
        data = "held-out data, every second block of the drive" if self.held_out else "the data of the fit"
        return (
            f"On {data}: {percent(self.line_percent)} with a line, {percent(self.cubic_percent)} with a cubic, "
            f"{percent(self.model_percent)} with this model."
        )


def residual(columns: np.ndarray, v: Vector, fitted: Mask | slice = slice(None)) -> Vector:
    """Residual (N,) of v (N,) for the combination of the columns (N, p) that is best over the fitted samples."""
    return np.asarray(v - columns @ np.linalg.lstsq(columns[fitted], v[fitted], rcond=None)[0])


def rms(error: Vector) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(error**2)))


def fit_of(recording: Recording, s: ModelStructure, errors: Vector, skipped: int, span: float) -> Fit:
    """What the errors (N,) of a model are over the samples after ``skipped``, beside those of a line and a cubic."""
    counted = counted_from(recording, skipped)
    error, x, y = errors[counted], recording.x[counted], recording.y[counted]
    stride = math.ceil(x.size / BASELINE_SAMPLES)
    u, v = s.unit_input(x[::stride]), s.unit_output(y[::stride])
    constant, slope = np.linalg.lstsq(chebvander(u, 1), v, rcond=None)[0].tolist()
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
        line=(constant, slope),
        span=span,
        missing=recording.length - skipped - error.size,
    )


def alternate_blocks(recording: Recording) -> Mask:
    """Whether each sample is in an even block of its part, shape (N,)."""
    sweeps = [np.abs(np.diff(sweep.x, prepend=sweep.x[0])) for sweep in recording.sweeps()]
    block = max(float(np.ptp(recording.x)) / BLOCKS, sum(float(travel.sum()) for travel in sweeps) / MOST_BLOCKS)
    blocks = [np.cumsum(np.maximum(travel / block, FEWEST_BLOCKS / recording.length)) for travel in sweeps]
    return np.asarray(np.concatenate(blocks).astype(int) % 2 == 0)


def cross_validate(
    recording: Recording, fitted: ForwardFit, skip: int, solving: Solving, span: float
) -> Baseline | None:
    """Errors of line, cubic and model of a recording on every second block, fitted to the others, per cent of ``span``;
    None with too few samples."""
    s, x, y = fitted.structure, recording.x, recording.y
    known = Parameters.known(fitted.dynamics, s.sample_time)
    even, counted = alternate_blocks(recording), counted_from(recording, skip)
    squares = np.zeros(3)
    for inside in (even & counted, ~even & counted):
        held_out = counted & ~inside
        if np.count_nonzero(inside) <= s.d or not held_out.any():
            return None
        errors = [residual(chebvander(s.unit_input(x), degree), y, inside) for degree in (1, 3)]
        model = fit_forward(recording, inside, s, fitted.states, fitted.v, solving, steps=STEPS, parameters=known)
        errors.append(s.y_scale * model.error)
        squares += [float(np.sum(error[held_out] ** 2)) for error in errors]
    line, cubic, model_error = (percent_of(span, rms) for rms in np.sqrt(squares / np.count_nonzero(counted)).tolist())
    return Baseline(line, cubic, model_error, held_out=True)
