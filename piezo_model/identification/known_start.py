"""The states before a recording of a known model, and the samples of a transient, for its validation.

The weights stay, and a constant is added to the output. Creep may have been driven before the recording, so each rate
may begin at a level of its own; otherwise the start is found as in an identification (`start`).
"""

from __future__ import annotations

import math

import numpy as np

import piezo_model
from piezo_model.identification.dynamics_parameters import Parameters
from piezo_model.identification.error_model import Solving, States, counted_from, one_thread
from piezo_model.identification.forward import NUDGE, Columns, ForwardFit, fit_forward, simulate
from piezo_model.identification.start import initial_segment, longest_transient, start_of, transient
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.simulation import Arrays
from solvers.arrays import Mask, Vector

FARTHEST = 2.0
"""Largest distance of a creep state before the first sample from the play's, normalised units."""


def start_and_transient(model: piezo_model.HysteresisCreepModel, recording: Recording) -> tuple[States, int]:
    """The states before the first sample of each part of a recording with which a model, and a constant added to it,
    err least, and the number of samples in a transient; those of the identification for its own recording."""
    s, solving = model.structure, Solving()
    if model.fitted is not None and was_fitted_to(model, recording):
        return model.starts, model.fitted.skipped
    v, sweeps = s.inverse_slope_map @ model.weights, list(recording.in_units(s.input_unit, s.output_unit).sweeps())
    states, skips = zip(*(_start_and_transient(model, sweep, v, solving) for sweep in sweeps), strict=True)
    return states, skips[0]


def was_fitted_to(model: piezo_model.HysteresisCreepModel, recording: Recording) -> bool:
    """Whether a model was fitted to exactly these samples."""
    return (
        model.fitted is not None
        and model.fitted.recording == recording.digest()
        and model.fitted.skipped < recording.length
        and len(model.starts) == len(recording.starts)
    )


def _start_and_transient(
    model: piezo_model.HysteresisCreepModel, part: Recording, v: Vector, solving: Solving
) -> tuple[OperatorState, int]:
    """The same of one part."""
    s, head = model.structure, initial_segment(part, model.structure)
    parameters = Parameters.known(model.dynamics, s.sample_time)
    shift, longest = Columns.of(np.ones(head.length)), longest_transient(head)

    def fitted(skip: int) -> tuple[ForwardFit, Vector]:
        counted = counted_from(head, skip)
        best = start_of(head, counted, s, v, solving, shift, parameters)[1]
        best = _with_creep_levels(head, counted, model.arrays, best, shift, solving, parameters)
        return best, _centred(best, counted)

    whole, error = fitted(0)
    if longest and np.max(np.abs(whole.error[:longest])) > np.max(np.abs(whole.error[longest:])):
        settled, later = fitted(longest)
        if skip := transient(error, later, longest):
            return settled.states[0], skip
    return whole.states[0], 0


def _with_creep_levels(
    part: Recording,
    counted: Mask,
    arrays: Arrays,
    found: ForwardFit,
    shift: Columns,
    solving: Solving,
    parameters: Parameters | None,
) -> ForwardFit:
    """The fit of known weights, those of ``arrays``, with the creep of each rate begun at a level of its own, if the
    gain is clear."""
    s, state = found.structure, found.states[0].copy()
    if not s.creep_rates:
        return found
    effects = []
    for rate in range(len(s.creep_rates)):
        nudged = state.copy()
        nudged.creep.reshape(-1, s.lanes)[rate, : s.n + 1] += NUDGE
        solving.passes += 1
        change = s.unit_output(simulate(s, arrays, part, [nudged], found.dynamics)) - found.y_model
        effects.append(change / NUDGE)

    def fit(further: Columns) -> ForwardFit:
        return fit_forward(
            part, counted, s, [state], found.v, solving, weights_known=True, further=further, parameters=parameters
        )

    farthest = np.array([math.inf, *[FARTHEST] * len(effects)])
    levels = fit(Columns(np.column_stack([shift.signals, *effects]), -farthest, farthest)).further[1:]
    state.creep.reshape(-1, s.lanes)[:, : s.n + 1] += levels[:, None]
    other = fit(shift)
    return other if found.improved_by(other, len(effects)) else found


def _centred(fit: ForwardFit, counted: Mask) -> Vector:
    """Errors (N,) of a fit from their median, as shares of the range."""
    return np.asarray(0.5 * (fit.error - np.median(fit.error[counted])))


@one_thread
def simulated(model: piezo_model.HysteresisCreepModel, recording: Recording, state: OperatorState | None) -> Vector:
    """Output (N,) of a model over a recording, from the states before each part with which it errs least, or from given
    ones before the first sample."""
    model = model.at(recording.sample_time)
    s = model.structure
    given = [] if state is None else [state]
    if len(given) < len(recording.starts):
        given += start_and_transient(model, recording)[0][len(given) :]
    return simulate(s, model.arrays, recording.in_units(s.input_unit, s.output_unit), given, model.dynamics)
