"""The program that the data of a cycle make, which the core has in slopes."""

import numpy as np

from piezo_model.core import State
from piezo_model.identification_problem import Excitation, IdentificationProblem
from piezo_model.learning.settings import MIN_SLOPE
from piezo_model.structure import ModelStructure


def gathered(core: State, s: ModelStructure, proximal: float) -> IdentificationProblem:
    """The problem of a cycle's data."""
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
