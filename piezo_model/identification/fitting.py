"""From a recording to the quadratic program (6) and its answer, given the structure and the states at the start."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import solvers
from piezo_model.data_basis import DataBasis
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector
from solvers.certificate import certify, exact_cost_gap


class IdentificationError(ValueError):
    """The data do not give a model; the message is one sentence that says why."""


@dataclass(frozen=True)
class Certificate:
    """Proof that the weights are the optimum: relative cost gap and violation, exact arithmetic."""

    cost_gap: float
    violation: float
    unique: bool


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
