"""The program of a learner that somebody solves beside the core: what the data of a cycle make, and any registered
solver's answer."""

import numpy as np

from piezo_model.core import State
from piezo_model.identification_problem import Excitation, IdentificationProblem
from piezo_model.learning.settings import MIN_SLOPE, LearningSettings
from piezo_model.learning.solving import solved
from piezo_model.structure import ModelStructure
from solvers.arrays import Matrix, Vector


def answer(settings: LearningSettings, P: Matrix, q: Vector, lower: Vector, start: Vector, c: float) -> Vector:
    """The solver's minimiser (d,) of ½ vᵀP v + qᵀv over v ≥ lower, warm from ``start``; NaN where it found none."""
    from qpsolvers import Problem

    return solved(
        settings.solver, settings.solver_options, Problem(P, q, lb=lower, ub=np.full(q.size, np.inf)), start, c
    )


def gathered(core: State, s: ModelStructure, proximal: float) -> IdentificationProblem:
    """The problem of a cycle's data, which the core has in slopes."""
    products, S = np.zeros((s.d + 1, s.d + 1)), s.inverse_slope_map
    products[np.triu_indices(s.d + 1)] = core["data"]
    products = products + np.triu(products, 1).T
    excitation = Excitation.of(s, core["covered"], core["r"], core["start_play"], core["start_creep"])
    return IdentificationProblem(
        s,
        S.T @ products[1:, 1:] @ S,
        S.T @ products[0, 1:],
        0.5 * float(products[0, 0]),
        excitation,
        s.slope_map @ core["reference"],
        proximal,
        MIN_SLOPE,
    )
