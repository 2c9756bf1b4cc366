"""A fit in detail: the model's output, the weights with the excitation of their operators, and the residual."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import welch

from piezo_model.identification.error_model import ProgramSolver, accumulate, counted_from
from piezo_model.identification.validation import Validation, model_output, start_and_transient
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.model import HysteresisCreepModel
from piezo_model.recordings import Recording
from solvers.arrays import Vector

LONGEST = 1_000_000
"""Largest number of samples in a review, from the start."""


@dataclass(frozen=True)
class Review:
    """A recording and its model."""

    model: HysteresisCreepModel
    x: Vector
    y: Vector
    y_model: Vector
    """Input, measured and modelled output in the model's units, shape (N,), without an offset, and with the lag of a
    sensor; straight lines where an output is missing."""
    skipped: int
    """Samples at the start that are not counted."""
    weights: Mapping[str, ArrayLike]
    """A table of the unknowns: name of the weight, its value in normalised units with w_H0 = 1, its interval at 95 %,
    NaN without one, the RMS of its operator's signal in normalised units, and its standing. Shape (d,) each."""
    sentences: tuple[str, ...]
    """Sentences of the identification, or of the validation."""
    fitted: bool
    """Whether the weights were identified from this recording."""

    @property
    def error(self) -> Vector:
        """Measured minus modelled, output unit, shape (N,)."""
        return self.y - self.y_model

    def spectrum(self) -> tuple[Vector, Vector]:
        """Frequencies in Hz and amplitude density of the counted error, output unit per √Hz; by Welch's method."""
        e = self.error[self.skipped :]
        f, power = welch(e - e.mean(), 1.0 / self.model.structure.sample_time, nperseg=min(4096, e.size))
        return f[1:], np.sqrt(power[1:])


def review(recording: Recording, model: HysteresisCreepModel, validation: Validation | None = None) -> Review:
    """Review the fit of a recording, with the start, skip and lag of its identification, or a validation."""
    s, report = model.structure, model.report
    part, shift = recording.head(LONGEST).in_units(s.input_unit, s.output_unit), 0.0
    if validation is not None:
        states, skip, shift = validation.states, validation.fit.skipped, validation.shift
        sentences = tuple(validation.sentences())
    else:
        states, skip = start_and_transient(model, recording)
        sentences = tuple(report["sentences"])
    part = replace(part, y=part.y - shift)
    states = states[: len(part.starts)]
    problem = accumulate(part, counted_from(part, skip), s, states, ProgramSolver())
    known = (report.get("intervals") or {}).get("weights") or [None] * s.d
    return Review(
        model,
        part.x,
        part.y,
        model_output(model.with_sensor, part, states, skip),
        skip,
        _weights(problem, model.weights, known),
        (*sentences, *(f"{remark[0].upper()}{remark[1:]}." for remark in recording.notes)),
        validation is None,
    )


def _weights(
    problem: IdentificationProblem, w: Vector, known: Sequence[Sequence[float] | None]
) -> dict[str, ArrayLike]:
    s, unknown = problem.structure, (math.nan, math.nan)
    at_bound = s.inverse_slope_map @ w <= s.lower_bounds(problem.min_slope) + 1e-9
    low, high = np.transpose([interval or unknown for interval in known])
    return {
        "weight": s.weight_names,
        "value": w,
        "low": low,
        "high": high,
        "excitation": np.sqrt(np.maximum(np.diag(problem.P), 0.0)),
        "standing": np.select([~problem.reached, at_bound], ["never reached", "at its bound"], "free"),
    }
