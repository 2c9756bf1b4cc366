"""The floor: the smallest error of a structure on one piece of a reference, fitted in hindsight to that piece.

A model is identified from the piece, drives the piece again from the same states, and is identified again from the
result; the smallest error of ROUNDS rounds counts.
"""

from copy import deepcopy

import numpy as np

from piezo_model import Compensator, DataBasis, HysteresisCreepModel, OperatorState
from piezo_model.identification.error_model import ProgramSolver
from piezo_model.plants import Plant
from solvers.arrays import Vector

ROUNDS = 4
SOLVER = "box_active_set"


def tracking_error(y: Vector, y_ref: Vector) -> float:
    """RMS of y − y_ref over the measured samples."""
    return float(np.sqrt(np.nanmean((y - y_ref) ** 2)))


def floor(
    model: HysteresisCreepModel, state: OperatorState, plant: Plant, x: Vector, y: Vector, y_ref: Vector
) -> float:
    """Tracking error over a piece, in the output's unit, by the best model of the same structure.

    Parameters
    ----------
    model : HysteresisCreepModel
        Initial model; weights that the piece does not determine keep its values.
    state, plant : OperatorState, Plant
        States of the model, and the plant, at the beginning of the piece; both stay unchanged.
    x, y, y_ref : array (N,)
        Drive, output and reference of the piece.
    """
    errors = []
    for _ in range(ROUNDS):
        basis, measured = DataBasis(model.structure, state), np.isfinite(y)
        for part in np.split(np.arange(y.size), np.flatnonzero(np.diff(measured)) + 1):
            basis.update(x[part], np.where(measured[part], y[part], 0.0), count=bool(measured[part[0]]))
        weights = ProgramSolver(SOLVER).optimum(basis.problem(model.weights))
        model = HysteresisCreepModel.from_weights(model.structure, weights)
        x = Compensator(model, plant.x_range, state=state).run(y_ref)
        y = deepcopy(plant).run(x)
        errors.append(tracking_error(y, y_ref))
    return min(errors)
