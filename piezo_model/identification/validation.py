"""Validation of a model on a recording, which is evidence if the recording was not used for its identification.

The weights are fixed, and the unknowns of the recording are estimated: the states before the first sample by the
variance of the output error, and a constant difference of the outputs by its mean. The stage may have crept before the
recording, so each creep rate may begin at a level of its own; otherwise the start is found as in an identification
(`start`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import piezo_model
from piezo_model.identification.adequacy import Fit, applicable, fit_of, outlier
from piezo_model.identification.dynamics_parameters import Parameters
from piezo_model.identification.error_model import ProgramSolver, States, counted_from, one_thread, percent_of
from piezo_model.identification.forward import NUDGE, Columns, ForwardFit, fit_forward
from piezo_model.identification.gram_matrix import initial_ringing
from piezo_model.identification.start import initial_segment, longest_transient, start_of, transient
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.units import percent, quantity
from solvers.arrays import Vector

FARTHEST, OUTLIER_SAMPLES = 2.0, 1_000_000
"""Largest initial distance of a creep state from the play's state, normalised units; samples from the start that are
searched for an outlier."""
WITHIN, FEWEST_INSIDE = 1.01, 0.2
"""Largest normalised input within the model's range, and smallest fraction of such samples that determines a shift,
since extrapolation has errors of its own."""


@dataclass(frozen=True)
class Validation:
    """The errors of a model on a recording."""

    model: piezo_model.HysteresisCreepModel
    fit: Fit
    """The errors as in an identification, with ``shift`` removed."""
    shift: float
    """Constant difference of the outputs, measured minus modelled, output unit."""
    states: States
    """Estimated states before the first sample of each part."""
    beyond_percent: float
    """Excess of the drive over the range of the identification, % of that range."""
    outlier: str | None
    """A clause about a single outlier of the output; None without one."""
    units: str
    """A sentence about the conversion of the recording's units; "" if there was none."""
    own: bool
    """True if the model was fitted to exactly these samples."""

    def to_dict(self) -> dict[str, Any]:
        """Numbers and sentences for JSON."""
        return {"fit": asdict(self.fit), "shift": self.shift, "own": self.own, "sentences": list(self.sentences())}

    def sentences(self) -> Iterator[str]:
        """The headline, then the other important sentences."""
        unit = self.model.structure.output_unit
        reported = self.model.report.get("fit", {}).get("rms", math.inf)
        return applicable(
            *((sentence, sentence) for sentence in (self.model.warning, self.fit.headline(unit, "on this recording"))),
            (self.own, "The model was fitted to this recording, so its errors say little about others."),
            (self.units, self.units),
            (self.outlier, self.outlier and f"{self.outlier[0].upper()}{self.outlier[1:]}."),
            (
                self.fit.skipped,
                f"The first {self.fit.skipped} samples are excluded as a switch-on transient, with errors of up to "
                f"{percent(self.fit.skipped_max_percent)}.",
            ),
            (
                abs(self.shift) > 0.1 * self.fit.rms,
                f"The output is shifted from that of the model by a constant {quantity(self.shift, unit, 3)} "
                f"({percent(percent_of(self.fit.span, abs(self.shift)))} of the range); the errors are without it.",
            ),
            (
                self.fit.rms > 2.0 * reported,
                f"The RMS error of {quantity(self.fit.rms, unit, 2)} is "
                f"{self.fit.rms / max(reported, 1e-11 * self.fit.span):.2g} times that on the recording of the "
                f"identification, {quantity(reported, unit, 2)}.",
            ),
            (
                self.beyond_percent > 1.0,
                f"The drive exceeds the range of the identification by {percent(self.beyond_percent)} of that range, "
                "where the model extrapolates; the constant shift is estimated within the range only.",
            ),
        )


@one_thread
def validate(model: piezo_model.HysteresisCreepModel, recording: Recording) -> Validation:
    """Validate a model on a recording; see ``HysteresisCreepModel.validate``."""
    model = model.at(recording.sample_time)
    s, own, with_sensor = model.structure, was_fitted_to(model, recording), model.with_sensor
    states, skip = start_and_transient(with_sensor, recording)
    recording = recording.in_units(s.input_unit, s.output_unit)
    errors, counted = recording.y - model_output(with_sensor, recording, states, skip), counted_from(recording, skip)
    inside = errors[counted & (np.abs(s.unit_input(recording.x)) <= WITHIN)]
    shift = float(inside.mean()) if inside.size > FEWEST_INSIDE * np.count_nonzero(counted) else 0.0
    farthest = float(np.max(np.abs(s.unit_input(np.array(recording.x_range)))))
    return Validation(
        model,
        fit_of(recording, s, errors - shift, skip, float(np.ptp(recording.y[skip:]))),
        shift,
        states,
        max(0.0, 50.0 * (farthest - 1.0)),
        outlier(recording, slice(OUTLIER_SAMPLES), s.output_unit),
        recording.units,
        own,
    )


def start_and_transient(model: piezo_model.HysteresisCreepModel, recording: Recording) -> tuple[States, int]:
    """The states before each part of a recording with which the model plus a constant has the smallest error, and the
    number of samples in a transient; for the recording of the identification, the states and samples found there."""
    s, qp_solver = model.structure, ProgramSolver()
    if model.fitted is not None and len(model.starts) == len(recording.starts) and was_fitted_to(model, recording):
        return model.starts, model.fitted.skipped
    v, own = s.inverse_slope_map @ model.weights, recording.in_units(s.input_unit, s.output_unit)
    starts = (_start_and_transient(model, own.part(part), v, qp_solver) for part in own.parts)
    states, skips = zip(*starts, strict=True)
    return states, skips[0]


def was_fitted_to(model: piezo_model.HysteresisCreepModel, recording: Recording) -> bool:
    """True if the model was fitted to exactly these samples."""
    fitted = model.fitted
    return fitted is not None and fitted.skipped < recording.length and recording.digest() in fitted.digests


def _start_and_transient(
    model: piezo_model.HysteresisCreepModel, part: Recording, v: Vector, qp_solver: ProgramSolver
) -> tuple[OperatorState, int]:
    """The states before one part, and the number of samples in a transient."""
    s, head = model.structure, initial_segment(part, model.structure)
    parameters = None if model.dynamics is None else Parameters(model.dynamics, s.sample_time)
    shift, longest = Columns.of(np.ones(head.length)), longest_transient(head)

    def fit_after(skip: int) -> tuple[ForwardFit, Vector]:
        best = start_of(head, counted_from(head, skip), s, v, qp_solver, shift, parameters)[1]
        best = _with_creep_levels(model, best, shift, qp_solver)
        return best, np.asarray(0.5 * (best.error - np.median(best.error[best.counted])))  # relative to the range

    whole, error = fit_after(0)
    if longest and np.max(np.abs(whole.error[:longest])) > np.max(np.abs(whole.error[longest:])):
        settled, later = fit_after(longest)
        if skip := transient(error, later, longest):
            return settled.states[0], skip
    return whole.states[0], 0


def _with_creep_levels(
    model: piezo_model.HysteresisCreepModel, start: ForwardFit, shift: Columns, qp_solver: ProgramSolver
) -> ForwardFit:
    """The fit of the weights of a model, with an initial level of its own for the creep of each rate, if the gain is
    significant."""
    s, state = start.structure, start.states[0].copy()
    if not s.creep_rates:
        return start
    effects = []
    for rate in range(len(s.creep_rates)):
        nudged = state.copy()
        nudged.creep.reshape(-1, s.lanes)[rate, : s.n + 1] += NUDGE
        qp_solver.passes += 1
        nudged_y = s.unit_output(model.simulate(start.recording.x, nudged))
        effects.append((nudged_y + start.ringing - start.y_model) / NUDGE)

    def fit(further: Columns) -> ForwardFit:
        return fit_forward(
            start.recording,
            start.counted,
            s,
            [state],
            start.v,
            qp_solver,
            weights_known=True,
            further=further,
            parameters=start.parameters,
        )

    levels = fit(shift.append(Columns.of(np.column_stack(effects), -FARTHEST, FARTHEST))).further[1:]
    state.creep.reshape(-1, s.lanes)[:, : s.n + 1] += levels[:, None]
    other = fit(shift)
    return other if start.improved_by(other, len(effects)) else start


def model_output(
    model: piezo_model.HysteresisCreepModel, recording: Recording, states: States, skip: int = 0
) -> Vector:
    """Output (N,) of a model over a recording in its units, from the states before each part, with the ringing from
    before the first sample after ``skip``."""
    y = _simulate(model, recording, states)
    error, counted = recording.y - y, counted_from(recording, skip)
    return y + initial_ringing([model.dynamics] * len(states), recording, error - error[counted].mean(), counted)


def _simulate(model: piezo_model.HysteresisCreepModel, recording: Recording, states: States) -> Vector:
    """Output (N,) of a model for a recording in its units, from the states before each part."""
    parts = zip(recording.parts, states, strict=True)
    return np.concatenate([model.simulate(recording.x[part], state) for part, state in parts])


@one_thread
def simulate_recording(
    model: piezo_model.HysteresisCreepModel, recording: Recording, state: OperatorState | None
) -> Vector:
    """Output (N,) of a model over a recording, from the states before each part that fit it best, or from ``state``
    before the first sample."""
    model = model.at(recording.sample_time)
    s = model.structure
    recording = recording.in_units(s.input_unit, s.output_unit)
    if state is None:
        return model_output(model, recording, start_and_transient(model, recording)[0])
    later = start_and_transient(model, recording)[0][1:] if recording.starts[1:] else []
    return _simulate(model, recording, [state, *later])
