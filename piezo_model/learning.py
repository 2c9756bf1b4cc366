"""How weights are learned while the machine runs: step by step, all at once, or continuously.

Each way takes the problem (6) in scaled slope coordinates and gives weights w (d,) in unit amplitudes, NaN where it has
none. What comes of them (check, hand-over) is the business of the machine in `self_learning`.
"""

from __future__ import annotations

import math
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from qpsolvers import Problem

import solvers
from piezo_model.data_basis import RegressorArrays, regressors
from piezo_model.identification_problem import Form, IdentificationProblem
from piezo_model.operator_state import OperatorState
from piezo_model.structure import ModelStructure
from solvers.kernel.recursive_active_set import RecursiveActiveSet

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class LearningPhase:
    """One learning phase with any registered solver.

    A solver that has ``begin`` and ``advance`` (the paper's difference equation) takes one step a sample. Any other
    solves once at the beginning, and its answer is there after as many samples as that took.

    Parameters
    ----------
    solver : str
    problem : IdentificationProblem
    weights : array (d,)
        Where learning starts from.
    samples_to_solve : int, optional
        Samples that one exact solve takes; measured by default.
    """

    def __init__(self, solver: str, problem: IdentificationProblem, weights: Vector,
                 samples_to_solve: int | None = None) -> None:
        self._form: Form = problem.form()
        self._engine = solvers.get(solver, tier="high")
        self._engine.setup(self._form.qp)
        start = np.maximum(self._form.variables(weights), self._form.qp.lb)
        self._stepwise = hasattr(self._engine, "advance")
        self.ready_after = 0
        """Samples after which the answer is there; 0 for one that gets better with each."""
        if self._stepwise:
            self._engine.begin(start)
            return
        begin = perf_counter()
        answer = np.array(self._engine.solve(warm_start=start if self._engine.warm_startable else None))
        spent = perf_counter() - begin
        self._answer = answer if self._engine.solution().found else np.full_like(answer, np.nan)
        sample_time = problem.structure.sample_time
        self.ready_after = max(1, math.ceil(spent / sample_time) if samples_to_solve is None else samples_to_solve)

    def advance(self, samples: int) -> None:
        """Spend so many sampling periods."""
        if self._stepwise:
            self._engine.advance(samples)

    @property
    def weights(self) -> Vector:
        """Weights (d,) so far."""
        z = self._engine.answer() if self._stepwise else self._answer
        return self._form.weights(np.maximum(z, self._form.qp.lb))


class ContinuousLearning:
    """The exact optimum of a forgetting data basis after every sample, the paper's outlook.

    Parameters
    ----------
    structure : ModelStructure
    state : OperatorState
        Of the actuator before the first sample; a copy is moved on.
    memory_s : float
        Time constant of forgetting in s.
    weights : array (d,)
        What is believed before any data, with the weight of ``belief`` of a full memory.
    min_slope, proximal : float
        As of ``IdentificationProblem``.
    """

    def __init__(self, structure: ModelStructure, state: OperatorState, memory_s: float, weights: Vector,
                 min_slope: float = 1e-3, proximal: float = 1e-10, belief: float = 1e-6) -> None:
        self.structure = structure
        self.state = state.copy()
        self._arrays = RegressorArrays.of(structure, "slope")
        forgetting = math.exp(-structure.sample_time / memory_s)
        self._engine = RecursiveActiveSet(forgetting=forgetting, proximal=proximal)
        v = structure.inverse_slope_map @ weights
        lb = structure.lower_bounds(min_slope)
        self._engine.setup(Problem(belief * np.eye(structure.d), -belief * np.maximum(v, lb), lb=lb,
                                   ub=np.full(structure.d, np.inf)))

    def rows(self, x: Vector, y: Vector) -> Matrix:
        """Rows (Ξ, x) of samples in unit amplitudes, shape (N, d + 1); moves the operator states on."""
        stride, width = self._arrays.stride, self._arrays.width
        raw = np.zeros(x.size * stride + stride)
        regressors(self._arrays, x, y, self.state.play, self.state.creep, raw, stride)
        return np.roll(raw[:x.size * stride].reshape(-1, stride)[:, :width], -1, axis=1)

    def take(self, rows: Matrix) -> None:
        """Learn from rows."""
        if rows.size:
            self._engine.append_many(rows)

    @property
    def weights(self) -> Vector:
        """The optimum (d,) in weight coordinates and unit amplitudes."""
        return self.structure.slope_map @ self._engine.solve()
