"""The model in plain NumPy, written from its equations alone as a reference for the compiled code; it imports no other
module of the project.

A structure is the dictionary that a model file holds. Amplitudes are of unit size.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


def thresholds(s: dict[str, Any]) -> Vector:
    return np.array([0.0, *s["play_thresholds"]])


def hysteresis_and_creep(s: dict[str, Any], x: Vector, z_H: Vector, z_K: Matrix) -> tuple[Matrix, Matrix]:
    """Outputs (N, n + 1) of the plays and, summed over the rates, of creep, from states (n + 1,) and (J, n + 1)."""
    r, z_H, z_K = thresholds(s), z_H.copy(), z_K.copy()
    share = np.array([[-np.expm1(-rate * s["sample_time"])] for rate in s["creep_rates"]]).reshape(-1, 1)
    H, K = np.empty((x.size, r.size)), np.empty((x.size, r.size))
    for k, value in enumerate(x):
        z_H = np.maximum(value - r, np.minimum(value + r, z_H))
        H[k], K[k] = z_H, z_K.sum(axis=0)
        away = value - z_K
        z_K = z_K + share * (np.maximum(away - r, 0.0) + np.minimum(away + r, 0.0))
    return H, K


def one_sided_dead_zones(r: Vector, u: Vector) -> Matrix:
    u = u[:, None]
    return np.where(r > 0, np.maximum(u - r, 0), np.where(r < 0, np.minimum(u - r, 0), u))


def rows(s: dict[str, Any], x: Vector, y: Vector, z_H: Vector, z_K: Matrix) -> Matrix:
    """The vectors Ξ (N, d) of the error model (5)."""
    H, K = hysteresis_and_creep(s, x, z_H, z_K)
    columns = [H[:, 1:], -one_sided_dead_zones(np.array(s["dead_zone_thresholds"]), y)]
    columns += [K] if s["creep_rates"] else []
    columns += [np.ones((x.size, 1))] if s["offset"] else []
    return np.hstack(columns)


def superposition(s: dict[str, Any], w_S_inverse: Vector, u: Vector) -> Vector:
    """S[u], the inverse of the piecewise linear function S⁻¹ given by its weights."""
    r = np.array(s["dead_zone_thresholds"])
    far = 1e4
    y = np.concatenate([[r[0] - far], r, [r[-1] + far]])
    return np.interp(u, one_sided_dead_zones(r, y) @ w_S_inverse, y)
