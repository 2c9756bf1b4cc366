"""The quadratic program (6) of a recording, its solution and the errors of the model, for a given structure and initial
state.

The errors are those of the output, for the model and for the best line and cubic.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

import solvers
from piezo_model.data_basis import DataBasis
from piezo_model.identification import alternative_models as models
from piezo_model.identification.fit_report import Certificate, Fit
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector
from solvers.certificate import certify, exact_cost_gap

if TYPE_CHECKING:
    from piezo_model.model import HysteresisCreepModel

BASELINE_SAMPLES = 1_000_000
"""Samples, spread over a longer recording, to which a line and a cubic are fitted."""
WITHIN, FEWEST_INSIDE = 1.01, 0.2
"""Largest unit amplitude of a drive within the model's range, and the smallest share of such samples that determines an
offset."""


class IdentificationError(ValueError):
    """The data do not give a model; the message is one sentence that says why."""


def filled(y: Vector) -> Vector:
    """A signal (N,) with straight lines over missing samples, for what needs even sampling; 0 if all are missing."""
    at, known = np.arange(y.size), ~np.isnan(y)
    return np.interp(at, at[known], y[known]) if known.any() else np.zeros_like(y)


def accumulate(
    recording: Recording,
    s: ModelStructure,
    skip: int,
    state: OperatorState,
    proximal: float,
) -> IdentificationProblem:
    """The program of a recording: the operators run from the first sample of each part on, and samples count after the
    first ``skip``."""
    basis, y = DataBasis(s, state), recording.counted_y
    y[:skip] = np.nan
    for first, last in pairwise((*recording.starts, recording.length)):
        if first:
            settled = OperatorState.settled_at(s, float(recording.x[first]))
            basis.state.play[:], basis.state.creep[:] = settled.play, settled.creep
        basis.update(recording.x[first:last], y[first:last])
    return basis.problem(proximal=proximal)


def simulate(model: HysteresisCreepModel, recording: Recording, state: OperatorState) -> Vector:
    """Output (N,) of the model, from the given states at the first sample, and settled at each later start."""
    y = np.empty(recording.length)
    for first, last in pairwise((*recording.starts, recording.length)):
        start = OperatorState.settled_at(model.structure, float(recording.x[first])) if first else state
        y[first:last], _ = model.advance(recording.x[first:last], start)
    return y


def optimum(problem: IdentificationProblem, solver: str) -> Vector:
    """Optimal weights (d,) in unit amplitudes; IdentificationError if the solver fails."""
    form, cls = problem.form(), solvers.find(solver).load()
    for rung in reversed(cls.ladder(form.c)):  # the tightest one may be beyond rounding
        engine = cls(**rung)
        engine.setup(form.qp)
        z = engine.solve().copy()
        if engine.solution().found and np.all(np.isfinite(z)):
            return form.weights(np.maximum(z, form.qp.lb))
    raise IdentificationError(f"the solver {solver} found no answer")


def prove(problem: IdentificationProblem, w: Vector) -> Certificate:
    """Distance of the weights (d,) from the optimum, proven in exact arithmetic."""
    form = problem.form()
    z = form.variables(w)
    certificate = certify(form.qp, z)
    gap = exact_cost_gap(form.qp, certificate, z, form.c)
    return Certificate(gap.relative, gap.violation, certificate.unique)


def error_percent(problem: IdentificationProblem, w: Vector) -> float:
    """RMS of the error (5), per cent of the input's range."""
    return 100.0 * math.sqrt(max(2.0 * problem.cost(w), 0.0)) / (problem.excitation.x_max - problem.excitation.x_min)


def forward_error(
    model: HysteresisCreepModel,
    recording: Recording,
    skipped: int,
    state: OperatorState,
    span: float,
    free_shift: bool = False,
) -> tuple[Fit, float]:
    """Errors over the samples after ``skipped``, per cent of ``span``, and the offset that ``free_shift`` removes.

    The offset is the mean error within the model's range, since extrapolation has errors of its own; 0 if the drive is
    hardly ever there.
    """
    s, y = model.structure, recording.counted_y
    error = y - simulate(model, recording, state)
    skipped_worst = float(np.nanmax(np.abs(error[:skipped]), initial=0.0))
    counted = ~np.isnan(error)
    counted[:skipped] = False
    x, y, error = recording.x[counted], y[counted], error[counted]
    inside = error[np.abs(s.unit_input(x)) <= WITHIN]
    shift = float(inside.mean()) if free_shift and inside.size > FEWEST_INSIDE * error.size else 0.0
    error -= shift
    rms, worst = float(np.sqrt(np.mean(error**2))), float(np.max(np.abs(error)))
    stride = max(1, recording.length // BASELINE_SAMPLES)
    u, v = s.unit_input(x[::stride]), s.unit_output(y[::stride])
    constant, slope = np.linalg.lstsq(models.polynomials(u, 1), v, rcond=None)[0].tolist()
    line, cubic = (models.rms(models.residual(models.polynomials(u, degree), v)) for degree in (1, 3))
    unit_percent = 100.0 * abs(s.y_scale) / span
    return Fit(
        error.size,
        skipped,
        100.0 * rms / span,
        100.0 * worst / span,
        rms,
        worst,
        100.0 * skipped_worst / span,
        unit_percent * line,
        unit_percent * cubic,
        (constant, slope),
        span,
        recording.length - skipped - error.size,
    ), shift
