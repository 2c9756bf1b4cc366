"""From a recording to the quadratic program (6), its answer and the errors of its model, given the structure and the
states at the start.

The errors are those of the output, of the model and of the best line and cubic beside it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

import solvers
from piezo_model.data_basis import DataBasis
from piezo_model.identification.alternative_models import left_over, polynomials
from piezo_model.identification.alternative_models import rms as rms_of
from piezo_model.identification.fit_report import Certificate, Fit
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector
from solvers.certificate import certify, exact_cost_gap

if TYPE_CHECKING:
    from piezo_model.model import HysteresisCreepModel

ENOUGH = 1_000_000
"""Samples that a line and a cubic are fitted to, of a longer recording spread over all of it."""
WITHIN, FEWEST_INSIDE = 1.01, 0.2
"""Unit amplitudes of a drive within the model's range, and the share of such samples from which on they tell an
offset."""


class IdentificationError(ValueError):
    """The data do not give a model; the message is one sentence that says why."""


def skipping(recording: Recording, skip: int) -> Iterator[tuple[Vector, Vector, int]]:
    """Chunks of a recording, each with how many of its samples are among the first ``skip``."""
    for x, y in recording.chunks():
        yield x, y, min(skip, x.size)
        skip -= min(skip, x.size)


def accumulate(
    recording: Recording,
    s: ModelStructure,
    skip: int,
    state: OperatorState,
    proximal: float,
) -> IdentificationProblem:
    """Run the operators over the whole recording from their states at its start, and count after ``skip`` samples."""
    basis = DataBasis(s, state)
    for x, y, head in skipping(recording, skip):
        basis.update(x[:head], y[:head], count=False)
        basis.update(x[head:], y[head:])
    return basis.problem(proximal=proximal)


def optimum(problem: IdentificationProblem, solver: str) -> Vector:
    """Weights (d,) that solve the program, in unit amplitudes.

    Raises
    ------
    IdentificationError
        If the solver found no answer.
    """
    form, cls = problem.form(), solvers.find(solver).load()
    for rung in reversed(cls.ladder(form.c)):  # the uppermost one may ask for more than rounding allows
        engine = cls(**rung)
        engine.setup(form.qp)
        z = engine.solve().copy()
        if engine.solution().found and np.all(np.isfinite(z)):
            return form.weights(np.maximum(z, form.qp.lb))
    raise IdentificationError(f"the solver {solver} found no answer")


def prove(problem: IdentificationProblem, w: Vector) -> Certificate:
    """How far the weights (d,) are from the optimum, which is proven in exact arithmetic."""
    form = problem.form()
    z = form.variables(w)
    certificate = certify(form.qp, z)
    gap = exact_cost_gap(form.qp, certificate, z, form.c)
    return Certificate(gap.relative, gap.violation, certificate.unique)


def error_percent(problem: IdentificationProblem, w: Vector) -> float:
    """RMS of the error (5) as a share of the input's range."""
    return 100.0 * math.sqrt(max(2.0 * problem.cost(w), 0.0)) / (problem.excitation.x_max - problem.excitation.x_min)


def forward_error(
    model: HysteresisCreepModel,
    recording: Recording,
    skipped: int,
    state: OperatorState,
    span: float,
    free_shift: bool = False,
) -> tuple[Fit, float]:
    """Figures over the samples after ``skipped``, per cent of ``span``, and the constant that ``free_shift`` removes.

    That is the mean error where the drive is within the model's range; 0 where it hardly is, since an extrapolation
    errs, too.
    """
    s, state, counted = model.structure, state.copy(), recording.length - skipped
    skipped_worst, low, high = 0.0, math.inf, -math.inf
    sums, stride, thinned = np.zeros(4), max(1, recording.length // ENOUGH), []
    for x, y, head in skipping(recording, skipped):
        error = y - model.simulate(x, state)
        skipped_worst = max(skipped_worst, float(np.max(np.abs(error[:head]), initial=0.0)))
        x, y, error = x[head:], y[head:], error[head:]
        low, high = float(np.min(error, initial=low)), float(np.max(error, initial=high))
        known = np.abs(s.unit_input(x)) <= WITHIN
        sums += np.sum(error), np.sum(np.square(error)), np.count_nonzero(known), np.sum(error[known])
        thinned.append((s.unit_input(x[::stride]), s.unit_output(y[::stride])))
    total, squares, inside, inside_total = sums.tolist()
    shift = inside_total / inside if free_shift and inside > FEWEST_INSIDE * counted else 0.0
    rms = math.sqrt(max(squares / counted - 2.0 * shift * total / counted + shift**2, 0.0))
    worst = max(high - shift, shift - low)
    u, v = (np.concatenate(parts) for parts in zip(*thinned, strict=True))
    constant, slope = np.linalg.lstsq(polynomials(u, 1), v, rcond=None)[0].tolist()
    line, cubic = (100.0 * abs(s.y_scale) / span * rms_of(left_over(polynomials(u, degree), v)) for degree in (1, 3))
    return Fit(
        counted,
        skipped,
        100.0 * rms / span,
        100.0 * worst / span,
        rms,
        worst,
        100.0 * skipped_worst / span,
        line,
        cubic,
        (constant, slope),
        span,
    ), shift
