"""The inverse (8) of a model in arrays that the core rewrites while it runs.

    x(k) = H⁻¹[ S⁻¹[y_r](k) − K(k) − offset ](k)

A hand-over of weights is one call that inverts H as in `inverse` and allocates nothing (``core/compensator.h``). The states are
those of the *model*, H and K, and those of H⁻¹ are derived from them at every sample: z'_i = W_i z_i + Σ_{j>i} w_Hj z_j.

Source: the paper's equation (8); K. Kuhnen, European Journal of Control 9 (2003) 407–418.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_model.core import State
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorArrays, SuperpositionArrays
from piezo_model.structure import ModelStructure

Vector = NDArray[np.float64]


class InverseArrays(NamedTuple):
    """Parameters of the inverse: unit amplitudes, padded to whole blocks of eight with thresholds and weights of zero."""

    operators: OperatorArrays
    w_H: Vector
    W_H: Vector
    """Partial sums of w_H, the slopes of H."""
    r_H_inverse: Vector
    w_H_inverse: Vector
    w_K: Vector
    """For every creep state, rate by rate."""
    S_inverse: SuperpositionArrays
    weights: Vector
    """All of them unpadded: w_H0 … w_Hn, w'_S, w_K, offset."""
    thresholds: int
    """n + 1."""
    zones: int

    @classmethod
    def of(cls, s: ModelStructure, core: State) -> InverseArrays:
        """Views of a compensator of the core."""
        return cls(OperatorArrays(core["r"], core["a"], len(s.creep_rates)), core["w_H"], core["W_H"], core["r_H_inverse"],
                   core["w_H_inverse"], core["w_K"], SuperpositionArrays(core["low"], core["high"], core["w_S"]), core["weights"],
                   s.n + 1, s.dead_zones)


def all_weights(model: HysteresisCreepModel) -> Vector:
    """The weights of a model in the order of ``InverseArrays.weights``."""
    return np.concatenate([model.w_H, model.w_S_inverse, model.w_K, [model.offset]])


def model_of(structure: ModelStructure, weights: Vector) -> HysteresisCreepModel:
    """Return the model that has the given ``InverseArrays.weights``."""
    ends = np.cumsum([structure.n + 1, structure.dead_zones, structure.creep_weights])
    w_H, w_S, w_K, offset = np.split(weights, ends)
    return HysteresisCreepModel(structure, w_H, w_S, w_K, float(offset[0]))
