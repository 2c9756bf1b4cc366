"""Where the loop of an actuator has its centre, for models without a constant.

The model is point-symmetric about the output that belongs to H + K = 0, and without a constant term that output is the
structure's centre. An asymmetric actuator has it elsewhere than in the middle of its range. A model of the same orders *with* a
constant, y = S[H[x] + K[x] + offset], finds it: y_centre = S[offset]. About that centre the constant is not needed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from piezo_model.model import HysteresisCreepModel


def loop_centre(model: HysteresisCreepModel) -> float:
    """Output, in the structure's unit, about which the model's hysteresis is point-symmetric: S[offset]."""
    s, S = model.structure, model.arrays.S
    zones = np.maximum(0.0, model.offset - S.high) + np.minimum(0.0, model.offset - S.low)
    return float(s.y_centre + s.y_scale * (S.w @ zones))


def inverse_superposition(model: HysteresisCreepModel, y: float) -> float:
    """S⁻¹[y] for an output in unit amplitudes."""
    S = model.arrays.S_inverse
    return float(S.w @ (np.maximum(0.0, y - S.high) + np.minimum(0.0, y - S.low)))


def centred(model: HysteresisCreepModel) -> HysteresisCreepModel:
    """Return the model about its own loop's centre and without a constant.

    Hysteresis and creep stay. The slopes of the new S⁻¹ are the mean ones of the old between the new thresholds. The new range
    reaches as far as the old one on the side that is farther away.

    Examples
    --------
    >>> from piezo_model.structure import ModelStructure
    >>> structure = ModelStructure.equidistant(n=1, m=1, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(),
    ...                                        sample_time=1e-3, offset=True)
    >>> model = HysteresisCreepModel.from_weights(structure, [0.5, 0.0, 1.0, 0.0, 0.25])  # y = S[H[x] + 0.25], S = 1
    >>> new = centred(model)
    >>> new.structure.y_centre, new.structure.y_scale, new.weights.round(12).tolist()
    (0.25, 1.25, [0.5, 0.0, 1.25, 0.0])
    """
    s, centre = model.structure, loop_centre(model)
    scale = max(s.y_centre + s.y_scale - centre, centre - s.y_centre + s.y_scale)
    structure = replace(s, offset=False, y_centre=centre, y_scale=scale)
    r = np.array(structure.dead_zone_thresholds)
    ends = np.array([min(-1.0, 2.0 * r[0]), *r[r < 0.0], *r[r > 0.0], max(1.0, 2.0 * r[-1])])
    u = np.array([inverse_superposition(model, (centre + scale * y - s.y_centre) / s.y_scale) for y in ends])
    block = structure.slices[1]
    w_S = structure.slope_map[block, block] @ (np.diff(u) / np.diff(ends))
    return HysteresisCreepModel(structure, model.w_H, w_S, model.w_K)
