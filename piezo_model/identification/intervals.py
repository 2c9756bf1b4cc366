"""Intervals of the weights and of what a data sheet says, at 95 %, from the linearisation of the forward fit:

    C = σ² τ / N · (JᵀJ / N)⁻¹   over the unknowns that no bound holds,

where σ² is the variance of the error, and τ = 1 + 2 Σ ρ_k its autocorrelation time, so that N / τ samples are
independent. A weight at its bound 0 has the interval from 0 to 1.96 of the deviations that it would have if released,
and so has hysteresis or creep at 0, which the data may hide; neither is below 0. Beside creep the offset has
none: it is that of a stage which has settled for ever.
The intervals are those for given orders; what the choice of orders adds is not in them. Where no more samples are
independent than there are unknowns, there are none.
"""

import math
from typing import Any

import numpy as np

from piezo_model.figures import figures_of
from piezo_model.identification.autocorrelation import DEVIATIONS, inverse_over
from piezo_model.identification.forward import ForwardFit
from piezo_model.model import HysteresisCreepModel
from piezo_model.units import SMALLEST_PERCENT

LEAST, STEP = np.array([-math.inf, 0.0, 0.0, -math.inf]), 1e-4
"""Bounds of the figures, of which hysteresis and creep are percentages, and change of a weight for their derivatives,
normalised units."""


def intervals(fit: ForwardFit) -> dict[str, Any] | None:
    """Intervals [low, high] of the weights of a fit, in the order of ``weight_names``, and of the figures by their
    names; None for a weight that the data do not determine, and for all if they determine none."""
    s, T = fit.structure, fit.structure.slope_map
    time, samples = fit.autocorrelation_time, np.count_nonzero(fit.counted)
    if (beyond := samples - np.count_nonzero(fit.free) * time) <= 0.0:
        return None
    variance, each = fit.cost * time / beyond, np.arange(fit.free.size)
    C = variance * inverse_over(fit.P, fit.free)[: s.d, : s.d]
    held = ~fit.free[: s.d] & (np.diag(fit.P)[: s.d] > 0.0)
    released = np.zeros(s.d)
    for i in np.flatnonzero(held).tolist():
        released[i] = variance * inverse_over(fit.P, fit.free | (each == i))[i, i]
    own, upwards = np.sqrt(np.maximum(np.diag(T @ C @ T.T), 0.0)), np.sqrt(released)  # 0 where rounding is all of it
    ends = np.column_stack([fit.weights - DEVIATIONS * own, fit.weights + DEVIATIONS * np.where(own, own, upwards)])
    at = figures_of(HysteresisCreepModel.from_weights(s, fit.weights))
    values, moved = np.array([*at.values()]), np.flatnonzero(fit.free[: s.d] | held)
    near = (HysteresisCreepModel.from_weights(s, T @ (fit.v + STEP * row)) for row in np.eye(s.d)[moved])
    slopes = (np.reshape([[*figures_of(model).values()] for model in near], (-1, values.size)) - values) / STEP
    spread, hidden = (
        np.sqrt(np.maximum(np.einsum("ik,ij,jk->k", slopes, each[np.ix_(moved, moved)], slopes), 0.0))
        for each in (C, np.diag(released))
    )
    wide = DEVIATIONS * np.where(values < LEAST + SMALLEST_PERCENT, np.maximum(hidden, spread), spread)
    between = np.column_stack([np.maximum(values - wide, LEAST), values + wide]).tolist()
    return {
        "weights": [pair if pair[0] < pair[1] else None for pair in ends.tolist()],
        "figures": {
            name: ends for name, ends in zip(at, between, strict=True) if name != "offset" or not s.creep_rates
        },
        "autocorrelation_time": time,
    }
