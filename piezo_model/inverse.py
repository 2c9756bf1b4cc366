"""Analytic inversion of the Prandtl–Ishlinskii operators, equation (8).

With the partial sums W_i = Σ_{j≤i} w_j of the weights over ascending thresholds 0 = r_0 < … < r_n:

    w'_0 = 1/w_0,   w'_i = −w_i / (W_i W_{i−1}),   r'_i = Σ_{j≤i} w_j (r_i − r_j)

for the hysteresis operator H, and for the superposition operator S on each side of zero alone. Inverting twice gives
the original back. The states of H⁻¹ follow from those of H (``core/compensator.c``).

Source: K. Kuhnen, European Journal of Control 9 (2003) 407–418.
"""

import numpy as np

from solvers.arrays import Vector


def invert_play(weights: Vector, thresholds: Vector) -> tuple[Vector, Vector]:
    """Weights and thresholds of H⁻¹.

    Parameters
    ----------
    weights, thresholds : array (n + 1,)
        w_H0 > 0, w_Hi such that all partial sums are positive; thresholds ascending from 0.

    Returns
    -------
    weights, thresholds : array (n + 1,)

    Examples
    --------
    >>> w, r = invert_play(np.array([1.0, 0.5]), np.array([0.0, 0.2]))
    >>> w.round(6).tolist(), r.tolist()
    ([1.0, -0.333333], [0.0, 0.2])
    """
    W = np.cumsum(weights)
    inverse = np.empty_like(weights)
    inverse[0] = 1.0 / weights[0]
    inverse[1:] = -weights[1:] / (W[1:] * W[:-1])
    inverse_thresholds = np.zeros_like(thresholds)
    np.cumsum(W[:-1] * np.diff(thresholds), out=inverse_thresholds[1:])  # Σ_{j≤i} w_j (r_i − r_j), summed by parts
    return inverse, inverse_thresholds


def invert_superposition(weights: Vector, thresholds: Vector) -> tuple[Vector, Vector]:
    """Weights and thresholds of S⁻¹.

    Parameters
    ----------
    weights, thresholds : array (2m + 1,)
        Thresholds ascending with 0 among them; the partial sums of the weights outwards from 0 are positive.

    Returns
    -------
    weights, thresholds : array (2m + 1,)

    Examples
    --------
    >>> w, r = invert_superposition(np.array([1.0, 2.0, -1.0]), np.array([-0.5, 0.0, 0.5]))
    >>> w.round(6).tolist(), r.tolist()
    ([-0.166667, 0.5, 0.5], [-1.0, 0.0, 1.0])
    """
    middle = int(np.flatnonzero(thresholds == 0.0)[0])
    upper_w, upper_r = invert_play(weights[middle:], thresholds[middle:])
    lower_w, lower_r = invert_play(weights[middle::-1], -thresholds[middle::-1])
    return np.concatenate([lower_w[:0:-1], upper_w]), np.concatenate([-lower_r[:0:-1], upper_r])
