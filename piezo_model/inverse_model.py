"""The weights of a model in one vector, as the core's compensator keeps them: w_H0 … w_Hn, w'_S, w_K, offset."""

from __future__ import annotations

import numpy as np

from piezo_model.model import HysteresisCreepModel
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector


def all_weights(model: HysteresisCreepModel) -> Vector:
    """The weights of a model in this order."""
    return np.concatenate([model.w_H, model.w_S_inverse, model.w_K, [model.offset]])


def model_of(structure: ModelStructure, weights: Vector) -> HysteresisCreepModel:
    """Return the model that has the given weights."""
    ends = np.cumsum([structure.n + 1, structure.dead_zones, structure.creep_weights])
    w_H, w_S, w_K, offset = np.split(weights, ends)
    return HysteresisCreepModel(structure, w_H, w_S, w_K, float(offset[0]))
