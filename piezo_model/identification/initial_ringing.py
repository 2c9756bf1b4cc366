"""The free ringing of the modes at the start of a recording, if the stage was in motion before its first sample:

    r(k) = Σ_i exp(−ζ_i ω_i t) (a_i cos ω_di t + b_i sin ω_di t),   ω_di = ω_i √(1 − ζ_i²),   t = (k − k₀) T

from the first counted sample k₀ of each part. The a and b are unknowns of every fit and are eliminated from it: they
minimise the error, and every column of the Jacobian is made orthogonal to the columns of r.

Source: G. Golub and V. Pereyra, "Separable nonlinear least squares: the variable projection method and its
applications", Inverse Problems 19 (2003) R1–R26.
"""

import math
from collections.abc import Sequence

import numpy as np

from piezo_model.dynamics import Dynamics
from piezo_model.recordings import Recording
from solvers.arrays import Mask, Matrix, Vector

DECAYED, ROUNDING = 25.0, 1e-12
"""Time constants after which a mode is at rest; fraction of a column's squares that may be rounding errors."""


def decays(dynamics: Dynamics | None, sample_time: float, counted: Mask) -> Matrix:
    """The columns (M, 2 k) of k modes over the first M samples of a part, after which the modes are at rest."""
    if dynamics is None or not (dynamics.frequencies_Hz and counted.any()):
        return np.zeros((0, 0))
    first, f, zeta = int(np.argmax(counted)), np.array(dynamics.frequencies_Hz), np.array(dynamics.damping)
    poles = 2.0 * math.pi * f * (-zeta + 1j * np.sqrt(1.0 - zeta**2)) * sample_time
    samples = min(counted.size - first, math.ceil(DECAYED / float(-poles.real.max())))
    ringing = np.exp(np.arange(samples)[:, None] * poles)
    return np.vstack([np.zeros((first, 2 * f.size)), np.hstack([ringing.real, ringing.imag])])


def initial_ringing(dynamics: Sequence[Dynamics | None], recording: Recording, error: Vector, counted: Mask) -> Vector:
    """The ringing (N,) that minimises the counted errors (N,), for the dynamics of each part."""
    ringing = np.zeros(error.size)
    for g, T, part in zip(dynamics, recording.periods, recording.parts, strict=True):
        columns = decays(g, T, counted[part])
        rings = slice(part.start, part.start + len(columns))
        if columns.size:
            own = columns[counted[rings]]
            ringing[rings] = columns @ np.linalg.lstsq(own, error[rings][counted[rings]], rcond=None)[0]
    return ringing


def orthogonal(gram: Matrix, first: int) -> Matrix:
    """The Gram matrix of the other columns, made orthogonal to the first ones, without the negative eigenvalues of
    rounding errors; 0 for a column of which only these remain."""
    A, B, C = gram[:first, :first], gram[:first, first:], gram[first:, first:]
    rest = C - B.T @ np.linalg.pinv(A, hermitian=True) @ B
    sizes = np.sqrt(np.where(np.diag(rest) > ROUNDING * np.diag(C), np.diag(rest), 0.0))
    scale = np.outer(sizes, sizes)
    eigenvalues, V = np.linalg.eigh(np.divide(rest, scale, out=np.zeros_like(rest), where=scale > 0.0))
    return np.asarray((V * np.maximum(eigenvalues, 0.0)) @ V.T * scale)
