"""95 % intervals of the weights and the data-sheet figures, from the linearisation of the forward fit:

    C = σ² τ / N · (JᵀJ / N)⁻¹   over the unknowns at no bound,

where σ² is the variance of the error, and τ = 1 + 2 Σ ρ_k its autocorrelation time, so that N / τ samples are
independent. The interval of a weight at its bound 0 reaches from 0 to 1.96 times the standard deviation that the weight
would have as a free unknown. The same holds for hysteresis and creep, which are never negative. In a model with creep
the offset has no interval: it is that of a stage which has settled for an infinite time.
The intervals hold for given orders, and do not include the uncertainty of their choice. Where the data choose the rates
of creep, one a decade, gain, hysteresis and creep are further uncertain by the creep of a fraction of a decade. There
are no intervals if the independent samples are no more than the unknowns.
"""

import math
from typing import Any

import numpy as np

from piezo_model.figures import figures_of
from piezo_model.identification.autocorrelation import DEVIATIONS
from piezo_model.identification.forward import ForwardFit
from piezo_model.model import HysteresisCreepModel
from piezo_model.units import SMALLEST_PERCENT

LEAST, STEP, CHOSEN = np.array([-math.inf, 0.0, 0.0, -math.inf]), 1e-4, 0.1
"""Lower bounds of the figures; step of a weight for their finite differences, normalised units; standard deviation by
the choice of creep rates, in decades of creep."""


def intervals(fit: ForwardFit, rates_chosen: bool) -> dict[str, Any] | None:
    """Intervals [low, high] of the weights of a fit, in the order of ``weight_names``, and of the figures by name; None
    for a weight that the data do not determine. None if no interval can be given."""
    s, T = fit.structure, fit.structure.slope_map
    time, samples = fit.autocorrelation_time, np.count_nonzero(fit.counted)
    if (beyond := samples - np.count_nonzero(fit.free) * time) <= 0.0:
        return None
    share, index = samples / beyond, np.arange(fit.free.size)
    C = share * fit.covariance_over(fit.free)[: s.d, : s.d]
    at_bound = ~fit.free[: s.d] & (np.diag(fit.P)[: s.d] > 0.0)
    released = np.array(
        [share * fit.covariance_over(fit.free | (index == i))[i, i] if at_bound[i] else 0.0 for i in range(s.d)]
    )
    down, up = np.sqrt(np.maximum(np.diag(T @ C @ T.T), 0.0)), np.sqrt(released)
    ends = np.column_stack([fit.weights - DEVIATIONS * down, fit.weights + DEVIATIONS * np.where(down, down, up)])
    at = figures_of(HysteresisCreepModel.from_weights(s, fit.weights))
    values, moved = np.array([*at.values()]), np.flatnonzero(fit.free[: s.d] | at_bound)
    near = (HysteresisCreepModel.from_weights(s, T @ (fit.v + STEP * row)) for row in np.eye(s.d)[moved])
    slopes = (np.reshape([[*figures_of(model).values()] for model in near], (-1, values.size)) - values) / STEP
    spread, hidden = (
        np.sqrt(np.maximum(np.einsum("ik,ij,jk->k", slopes, covariance[np.ix_(moved, moved)], slopes), 0.0))
        for covariance in (C, np.diag(released))
    )
    by_choice = CHOSEN * rates_chosen * at["creep_percent_per_decade"] * np.array([at["gain"] / 100.0, 1.0, 1.0, 0.0])
    spread = np.hypot(spread, by_choice)
    wide = DEVIATIONS * np.where(values < LEAST + SMALLEST_PERCENT, np.maximum(hidden, spread), spread)
    between = np.column_stack([np.maximum(values - wide, LEAST), values + wide]).tolist()
    return {
        "weights": [pair if pair[0] < pair[1] else None for pair in ends.tolist()],
        "figures": {
            name: ends for name, ends in zip(at, between, strict=True) if name != "offset" or not s.creep_rates
        },
        "autocorrelation_time": time,
    }
