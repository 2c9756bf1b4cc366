"""A fit beside the best straight line and the best cubic, all three by cross-validation on data left out.

The drive is cut into blocks of a share of its range, travelled up or down, or of time where it rests, so that every
branch of every loop has several and one loop is enough. Each of the three is fitted to every second block and judged on
the others, and the other way round; the operators of the model run through all of them. Errors are those of the output,
RMS.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from piezo_model.data_basis import DataBasis
from piezo_model.identification.alternative_models import left_over, polynomials
from piezo_model.identification.fit_report import Baseline
from piezo_model.identification.fitting import optimum
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Mask, Vector

BLOCKS = 16
"""Blocks to a way through the whole range, up to about MOST_BLOCKS in all."""
FEWEST_BLOCKS, MOST_BLOCKS = 64, 2000


def alternate_blocks(x: Vector) -> Mask:
    """Whether each sample is in a block of the first kind, shape (N,)."""
    way = np.abs(np.diff(x))
    block = max(float(np.ptp(x)) / BLOCKS, float(way.sum()) / MOST_BLOCKS)
    passed = np.concatenate([[0.0], np.cumsum(np.maximum(way / block, FEWEST_BLOCKS / x.size))])
    mask: Mask = passed.astype(int) % 2 == 0
    return mask


def cross_validate(
    recording: Recording, s: ModelStructure, skip: int, state: OperatorState, solver: str, proximal: float
) -> Baseline | None:
    """Judge line, cubic and model of a recording on every second block, fitted to the others; None where these are too
    few."""
    x, y = recording.arrays()
    first = alternate_blocks(x)
    counted = np.arange(x.size) >= skip
    squares = np.zeros(3)
    for fitted in (first & counted, ~first & counted):
        left_out = counted & ~fitted
        if fitted.sum() <= s.d or not left_out.any():
            return None
        model = HysteresisCreepModel.from_weights(s, _weights(x, y, s, fitted, state, solver, proximal))
        errors = [left_over(polynomials(s.unit_input(x), degree), y, fitted) for degree in (1, 3)]
        errors.append(model.simulate(x, state.copy()) - y)
        squares += [float(np.sum(error[left_out] ** 2)) for error in errors]
    span = 2.0 * abs(s.y_scale)
    line, cubic, model_error = 100.0 * np.sqrt(squares / counted.sum()) / span
    return Baseline(float(line), float(cubic), float(model_error))


def _weights(
    x: Vector, y: Vector, s: ModelStructure, fitted: Mask, state: OperatorState, solver: str, proximal: float
) -> Vector:
    basis = DataBasis(s, state)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(fitted)) + 1, [x.size]])
    for start, stop in pairwise(edges):
        basis.update(x[start:stop], y[start:stop], count=bool(fitted[start]))
    return optimum(basis.problem(proximal=proximal), solver)
