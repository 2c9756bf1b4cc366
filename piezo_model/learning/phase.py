"""One learning phase: the problem (6) of a data basis is being solved while the machine runs.

A solver of steps (the paper's difference equation) takes one a sample and has an answer at any time; any other solves once
at the beginning, and its answer is there after as many samples as that took. Both work in scaled slope coordinates and
give weights w (d,) in unit amplitudes. What comes of them (check, hand-over) is the business of `cyclic_learning`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

import solvers
from piezo_model.identification_problem import Form, IdentificationProblem
from piezo_model.learning.cyclic_step import SteppedSolver
from solvers.kernel.projected_difference import ProjectedDifference
from solvers.kernels.cone_projection import Cone
from solvers.kernels.projected_engine import ProjectedEngine
from solvers.kernels.projected_step import Recursion
from solvers.protocol import Solver

Vector = NDArray[np.float64]

class LearningPhase:
    """One learning phase with any registered solver.

    Parameters
    ----------
    solver : str
    problem : IdentificationProblem
    weights : array (d,)
        Where learning starts from.
    samples_to_solve : int, optional
        Samples that one exact solve takes; measured by default.
    options : mapping, optional
        Lane, tier and the solver's own settings as of ``solvers.get``; the tier is high by default.
    answer : array (d,), optional
        Iterate or answer, as of :attr:`answer`, of a learning phase to go on with; nothing is solved then.

    Examples
    --------
    >>> from piezo_model import DataBasis, ModelStructure
    >>> structure = ModelStructure.equidistant(n=1, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(), sample_time=1e-3)
    >>> basis, x = DataBasis(structure), np.sin(np.arange(1000) / 50)
    >>> basis.update(x, x / 2)
    >>> phase = LearningPhase("box_active_set", basis.problem(), structure.straight_line, samples_to_solve=3)
    >>> phase.ready_after, phase.weights.round(6).tolist()
    (3, [0.0, 2.0])
    """

    def __init__(self, solver: str, problem: IdentificationProblem, weights: Vector, samples_to_solve: int | None = None,
                 options: Mapping[str, Any] | None = None, answer: Vector | None = None) -> None:
        self.problem = problem
        self._form: Form = problem.form()
        engine = solvers.get(solver, **{"tier": "high", **(options or {})})
        self._engine: Solver | ProjectedEngine = engine
        if isinstance(engine, ProjectedDifference):
            self._engine = ProjectedEngine(**engine.settings)
        self._engine.setup(self._form.qp)
        start = np.maximum(self._form.variables(weights), self._form.qp.lb)
        self.ready_after = 0
        """Samples after which the answer is there; 0 for one that gets better with each."""
        self.arrays = no_steps()
        if isinstance(self._engine, ProjectedEngine):
            self._engine.begin(start if answer is None else answer)
            self.arrays = stepped(self._engine.recursion, problem.structure.d)
            return
        if answer is None:
            begin = perf_counter()
            found = np.array(self._engine.solve(warm_start=start if self._engine.warm_startable else None))
            spent = perf_counter() - begin
            answer = found if self._engine.solution().found else np.full_like(found, np.nan)
            self.ready_after = max(1, math.ceil(spent / problem.structure.sample_time) if samples_to_solve is None
                                   else samples_to_solve)
        self._answer = answer

    @property
    def answer(self) -> Vector:
        """Where it stands, (d,), in the variables of the form."""
        return self._engine.answer() if isinstance(self._engine, ProjectedEngine) else self._answer

    @property
    def weights(self) -> Vector:
        """Weights (d,) so far, NaN where the solver found none."""
        return self._form.weights(np.maximum(self.answer, self._form.qp.lb))


def stepped(recursion: Recursion, d: int) -> SteppedSolver:
    """Arguments with which compiled code takes the steps of a recursion."""
    return SteppedSolver(recursion._work, d, *recursion._arguments)


@cache
def no_steps() -> SteppedSolver:
    """What stands for a solver that is not one of steps."""
    return stepped(Recursion(1, Cone(None, None, np.zeros(1), np.ones(1))), 0)
