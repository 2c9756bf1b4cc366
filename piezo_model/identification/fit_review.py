"""A fit in detail: the model's output, the weights with the excitation of their operators, and the residual."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.signal import welch

from piezo_model.identification.fitting import accumulate, filled
from piezo_model.identification.sensor_lag import without_lag
from piezo_model.identification.validation import Validation
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.model import HysteresisCreepModel
from piezo_model.recordings import Recording
from solvers.arrays import Vector

LONGEST = 1_000_000
"""Largest number of samples in a review, from the start."""


@dataclass(frozen=True)
class Weight:
    """One unknown."""

    name: str
    value: float
    """Weight in unit amplitudes, with w_H0 = 1."""
    excitation: float
    """RMS of the operator's signal in unit amplitudes."""
    reached: bool
    at_bound: bool


@dataclass(frozen=True)
class Review:
    """A recording and its model."""

    model: HysteresisCreepModel
    x: Vector
    y: Vector
    y_model: Vector
    """Input, measured and modelled output in the model's units, shape (N,), without a removed lag or offset."""
    skipped: int
    """Samples at the start that are not counted."""
    weights: tuple[Weight, ...]
    sentences: tuple[str, ...]
    """Sentences of the identification, or of the validation."""
    fitted: bool
    """Whether the weights were identified from this recording."""

    @property
    def error(self) -> Vector:
        """Measured minus modelled, output unit, shape (N,); straight lines where the output is missing."""
        return filled(self.y - self.y_model)

    def spectrum(self) -> tuple[Vector, Vector]:
        """Frequencies in Hz and amplitude density of the counted error, output unit per √Hz; by Welch's method."""
        e = self.error[self.skipped :]
        f, power = welch(e - e.mean(), 1.0 / self.model.structure.sample_time, nperseg=min(4096, e.size))
        return f[1:], np.sqrt(power[1:])

    def advice(self) -> Iterator[str]:
        """Recommendations."""
        report = self.model.report
        if self.fitted:
            yield from report["advice"]
            for names in report["excitation"]["undetermined"]:
                yield (
                    f"Vary the drive more, in amplitude and speed: the weights {names} cannot be distinguished from "
                    "each other."
                )
        f, density = self.spectrum()
        share = float(np.sum(density[f <= f[-1] / 20.0] ** 2) / np.sum(density**2)) if np.any(density) else 0.0
        if share > 0.8:
            yield (
                f"{100.0 * share:.0f} % of the error's power lies below a twentieth of the highest frequency: the "
                "model misses "
                f"something slow, such as hysteresis between thresholds or creep, and it is not the sensor's noise."
            )
        elif share < 0.2:
            yield "The error is spread over all frequencies like noise: a higher order would gain little."


def review(recording: Recording, model: HysteresisCreepModel, validation: Validation | None = None) -> Review:
    """Review the fit of a recording, with the start, skip and lag of its identification, or a validation."""
    s, report = model.structure, model.report
    part, shift = recording.head(LONGEST).in_units(s.input_unit, s.output_unit), 0.0
    if validation is not None:
        state, skip, shift = validation.start, validation.fit.skipped, validation.shift
        sentences = tuple(validation.sentences())
    else:
        assert model.start is not None  # every identification sets it
        state, skip, sentences = model.start, int(report["fit"]["skipped"]), tuple(report["sentences"])
    if (lag := report.get("lag")) is not None and lag["removed"]:
        part, _, state = without_lag(part, s, lag["samples"], 0, state)
    x, y = part.x, part.counted_y
    y_model, y = model.simulate(x, state), y - shift
    problem = accumulate(Recording.from_arrays(x, y, part.sample_time), s, skip, state, 1e-10)
    return Review(
        model,
        x,
        y,
        y_model,
        skip,
        tuple(_weights(problem, model.weights)),
        (*sentences, *(f"{remark[0].upper()}{remark[1:]}." for remark in recording.remarks)),
        validation is None,
    )


def _weights(problem: IdentificationProblem, w: Vector) -> Iterator[Weight]:
    s = problem.structure
    at_bound = s.inverse_slope_map @ w <= s.lower_bounds(problem.min_slope) + 1e-9
    excitation = np.sqrt(np.maximum(np.diag(problem.P), 0.0))
    for i, name in enumerate(s.weight_names):
        yield Weight(name, float(w[i]), float(excitation[i]), bool(problem.reached[i]), bool(at_bound[i]))
