"""The inverse (8) of a model in arrays that compiled code can rewrite while it runs.

    x(k) = H⁻¹[ S⁻¹[y_r](k) − K(k) − offset ](k)

A hand-over of weights is one call, :func:`set_weights`, that inverts H as in `inverse` and allocates nothing. The states are
those of the *model*, H and K, and those of H⁻¹ are derived from them at every sample: z'_i = W_i z_i + Σ_{j>i} w_Hj z_j.

Source: the paper's equation (8); K. Kuhnen, European Journal of Control 9 (2003) 407–418.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_model.model import HysteresisCreepModel, superposition
from piezo_model.operator_state import OperatorArrays, SuperpositionArrays
from piezo_model.operators import play_step
from piezo_model.structure import ModelStructure
from solvers.compiled import inlined, kernel
from solvers.vector8 import load8, splat8, sum8

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
    def of(cls, s: ModelStructure) -> InverseArrays:
        """Arrays of a structure, all weights zero."""
        r_S = np.array(s.dead_zone_thresholds)
        lanes, creep = s.lanes, len(s.creep_rates) * s.lanes
        return cls(OperatorArrays.of(s), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes),
                   np.zeros(creep), SuperpositionArrays.of(np.zeros_like(r_S), r_S),
                   np.zeros(s.n + 2 + s.dead_zones + s.creep_weights), s.n + 1, s.dead_zones)


def all_weights(model: HysteresisCreepModel) -> Vector:
    """The weights of a model in the order of ``InverseArrays.weights``."""
    return np.concatenate([model.w_H, model.w_S_inverse, model.w_K, [model.offset]])


def model_of(structure: ModelStructure, weights: Vector) -> HysteresisCreepModel:
    """Return the model that has the given ``InverseArrays.weights``."""
    ends = np.cumsum([structure.n + 1, structure.dead_zones, structure.creep_weights])
    w_H, w_S, w_K, offset = np.split(weights, ends)
    return HysteresisCreepModel(structure, w_H, w_S, w_K, float(offset[0]))


@kernel
def set_weights(p: InverseArrays, weights: Vector) -> None:
    """Invert the model of these weights into the arrays; they must be those of a valid model."""
    for i in range(weights.size):
        p.weights[i] = weights[i]
    W, r = weights[0], 0.0
    p.w_H[0], p.W_H[0], p.w_H_inverse[0] = W, W, 1.0 / W
    for i in range(1, p.thresholds):
        r += W * (p.operators.r[i] - p.operators.r[i - 1])  # Σ_{j≤i} w_j (r_i − r_j), summed by parts
        before = W
        W += weights[i]
        p.w_H[i], p.W_H[i] = weights[i], W
        p.w_H_inverse[i], p.r_H_inverse[i] = -weights[i] / (W * before), r
    for i in range(p.zones):
        p.S_inverse.w[i] = weights[p.thresholds + i]
    first, lanes = p.thresholds + p.zones, p.operators.r.size
    for j in range(p.operators.rates):
        for i in range(p.thresholds):
            p.w_K[j * lanes + i] = weights[first + i]


@inlined
def wanted_drive(p: InverseArrays, y_ref: float, play: Vector, creep: Vector) -> float:
    """Drive that makes the model's next output y_ref, without any limit; moves no state on. All in unit amplitudes."""
    K = splat8(0.0)
    for i in range(0, creep.size, 8):
        K = K + load8(p.w_K, i) * load8(creep, i)
    u = superposition(y_ref, p.S_inverse) - sum8(K) - p.weights[p.weights.size - 1]
    x = p.w_H_inverse[0] * u
    outside = 0.0
    for i in range(p.thresholds - 1, 0, -1):
        state = p.W_H[i] * play[i] + outside
        outside += p.w_H[i] * play[i]
        x += p.w_H_inverse[i] * play_step(u, p.r_H_inverse[i], state)
    return x
