"""Intervals of the weights and of what a data sheet says, at 95 %, from the linearisation of the forward fit:

    C = σ² τ / N · (JᵀJ / N)⁻¹   over the unknowns that no bound holds,

where σ² is the variance of the error, and τ = 1 + 2 Σ ρ_k its autocorrelation time, so that N / τ samples are
independent. A weight at its bound 0 has the interval from 0 to 1.96 of the deviations that it would have if released.
The intervals are those for given orders; what the choice of orders adds is not in them. Where no more samples are
independent than there are unknowns, there are none.
"""

import math
from typing import Any

import numpy as np

from piezo_model.figures import figures_of
from piezo_model.identification.autocorrelation import DEVIATIONS, autocorrelation_time, inverse_over
from piezo_model.identification.forward import ForwardFit
from piezo_model.model import HysteresisCreepModel

STEP = 1e-4
"""Change of a weight for the derivatives of the figures, normalised units."""


def intervals(fit: ForwardFit) -> dict[str, Any] | None:
    """Intervals [low, high] of the weights of a fit, in the order of ``weight_names``, and of the figures by their
    names; None for a weight that the data do not determine, and for all if they determine none."""
    s, T = fit.structure, fit.structure.slope_map
    time, samples = autocorrelation_time(fit.errors), sum(error.size for error in fit.errors)
    if (beyond := samples - np.count_nonzero(fit.free) * time) <= 0.0:
        return None
    variance = fit.cost * time / beyond
    C = variance * inverse_over(fit.P, fit.free)[: s.d, : s.d]
    weights, deviations = fit.weights, np.sqrt(np.maximum(np.diag(T @ C @ T.T), 0.0))  # 0 where rounding is all of it
    ranges: list[list[float] | None] = []
    for i, (weight, deviation) in enumerate(zip(weights.tolist(), deviations.tolist(), strict=True)):
        if deviation > 0.0:
            ranges.append([weight - DEVIATIONS * deviation, weight + DEVIATIONS * deviation])
        elif fit.P[i, i] > 0.0 and not fit.free[i]:
            released = fit.free.copy()
            released[i] = True
            own = DEVIATIONS * math.sqrt(variance * inverse_over(fit.P, released)[i, i])
            ranges.append([weight, weight + own])
        else:
            ranges.append(None)
    at = figures_of(HysteresisCreepModel.from_weights(s, weights))
    free = np.flatnonzero(fit.free[: s.d])
    changes = np.array([[*_moved(fit, i).values()] for i in free.tolist()]).reshape(free.size, len(at))
    slopes = (changes - np.array([*at.values()])) / STEP
    spread = DEVIATIONS * np.sqrt(np.einsum("ik,ij,jk->k", slopes, C[np.ix_(free, free)], slopes))
    bounds = {name: [at[name] - wide, at[name] + wide] for name, wide in zip(at, spread.tolist(), strict=True)}
    return {"weights": ranges, "figures": bounds, "autocorrelation_time": time}


def _moved(fit: ForwardFit, i: int) -> dict[str, float]:
    """The figures with one weight changed."""
    v = fit.v.copy()
    v[i] += STEP
    return figures_of(HysteresisCreepModel.from_weights(fit.structure, fit.structure.slope_map @ v))
