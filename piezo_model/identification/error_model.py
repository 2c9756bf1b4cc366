"""The quadratic program (6) of a recording, its solution and its proof, for a structure and initial states.

Its error (5), x + Ξ(x, y)ᵀw, is referred to the input and linear in the weights; `forward` minimises the output error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

import solvers
from piezo_model import checks
from piezo_model.data_basis import DataBasis
from piezo_model.identification.gram_matrix import gram_of
from piezo_model.identification_problem import Excitation, IdentificationProblem
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.solving import solved
from piezo_model.structure import ModelStructure
from solvers.arrays import Mask, Matrix, Vector
from solvers.certificate import certify, exact_cost_gap

States = Sequence[OperatorState]
"""States before the first sample of each part."""

one_thread = threadpool_limits.wrap(limits=1, user_api="blas")
"""Decorator that makes results independent of the number of cores, and is faster for small matrices."""


class IdentificationError(ValueError):
    """No model can be identified from the data; the message is one sentence with the reason."""


@dataclass
class ProgramSolver:
    """Solves all programs of an identification, and counts the work."""

    solver: str = "box_active_set"
    proximal: float = 1e-10
    passes: int = 0
    """Number of passes over the samples."""
    programs: int = 0

    def optimum(self, problem: IdentificationProblem) -> Vector:
        """Optimal weights (d,) of (6) in normalised units; IdentificationError if the solver fails."""
        self.programs += 1
        form = problem.form()
        return form.weights(np.maximum(_solve(form.qp, form.c, self.solver), form.qp.lb))

    def minimise(self, P: Matrix, q: Vector, lb: Vector, ub: Vector, towards: Vector) -> Vector:
        """The z (k,) in a box that minimises ½ zᵀP z + qᵀz, with a proximal term towards a point."""
        self.programs += 1
        rho = self.proximal * float(np.mean(np.diag(P)))
        D = 1.0 / np.sqrt(np.maximum(np.diag(P) + rho, np.finfo(float).tiny))
        scaled = (P + rho * np.eye(q.size)) * np.outer(D, D)
        scaled_ub = None if np.all(np.isinf(ub)) else ub / D
        qp = solvers.Problem(0.5 * (scaled + scaled.T), (q - rho * towards) * D, lb=lb / D, ub=scaled_ub)
        return np.clip(_solve(qp, 1.0, self.solver) * D, lb, ub)


def _solve(qp: solvers.Problem, c: float, solver: str) -> Vector:
    """Solution of a box-constrained program whose cost has the constant c; IdentificationError if the solver fails."""
    z = solved(solver, None, qp, c=c)
    checks.check(np.all(np.isfinite(z)), f"the solver {solver} found no solution", IdentificationError)
    return z


def counted_from(recording: Recording, skip: int) -> Mask:
    """Mask (N,) of the counted samples: those with a measured output, after the skipped ones."""
    counted = ~recording.uncounted
    counted[:skip] = False
    return counted


def percent_of(span: float, value: float) -> float:
    """A value as a percentage of a range, or of itself if the range is 0.

    Examples
    --------
    >>> percent_of(4.0, 1.0), percent_of(0.0, 1.0), percent_of(0.0, 0.0)
    (25.0, 100.0, 0.0)
    """
    return 100.0 * value / (span or abs(value) or 1.0)


def accumulate(
    recording: Recording, counted: Mask, s: ModelStructure, states: States, qp_solver: ProgramSolver
) -> IdentificationProblem:
    """The program of a recording, with the operators run from the first sample of each part."""
    qp_solver.passes += 1
    if len(set(recording.owners)) > 1:
        return _accumulate_together(recording, counted, s, states, qp_solver)
    basis, y = DataBasis(s, states[0]), np.where(counted, recording.y, np.nan)
    for part, state in zip(recording.parts, states, strict=True):
        basis.state.play[:], basis.state.creep[:] = state.play, state.creep
        basis.update(recording.x[part], y[part])
    return basis.problem(proximal=qp_solver.proximal)


def _accumulate_together(
    recording: Recording, counted: Mask, s: ModelStructure, states: States, qp_solver: ProgramSolver
) -> IdentificationProblem:
    """The program of several recordings, with weighted means and with creep at the sampling period of each."""
    unit_x, unit_y = s.unit_input(recording.x[counted]), s.unit_output(recording.y)
    gram, moved = gram_of(
        recording, counted, s, (states,), unit_y, lambda _part, _at, rows: rows, np.zeros((recording.length, 0))
    )
    ends = [float(end) for v in (unit_x, unit_y[counted]) for end in (v.min(), v.max())]
    moved_plays, moved_creep = (tuple(moved[s.slices[i]].tolist()) for i in (0, 2))
    excitation = Excitation(ends[0], ends[1], ends[2], ends[3], moved_plays, moved_creep)
    return IdentificationProblem(
        s, gram[1:, 1:], gram[0, 1:], 0.5 * float(gram[0, 0]), excitation, proximal=qp_solver.proximal
    )


@dataclass(frozen=True)
class Certificate:
    """How far the weights are from the proven optimum: relative cost gap and violation, in exact arithmetic."""

    cost_gap: float
    violation: float
    unique: bool | None
    """Whether the optimum is unique; None if undecided."""


def prove(problem: IdentificationProblem, w: Vector) -> Certificate:
    """The certificate of weights (d,)."""
    form = problem.form()
    z = form.variables(w)
    certificate = certify(form.qp, z)
    gap = exact_cost_gap(form.qp, certificate, z, form.c)
    return Certificate(gap.relative, gap.violation, certificate.unique)
