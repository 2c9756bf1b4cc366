"""The three elementary operators of the modified Prandtl–Ishlinskii model with creep.

With x(k) the input, r a threshold, z a state and Ts the sampling period:

    play          z(k) = max(x(k) − r, min(x(k) + r, z(k−1)))
    dead zone     S_r(u) = max(u − r, 0) for r > 0,  min(u − r, 0) for r < 0,  u for r = 0
    creep         z(k) = z(k−1) + (1 − e^(−a·Ts)) · dz(x(k−1) − z(k−1), r),  dz(u, r) = max(u − r, 0) + min(u + r, 0)

The creep line is the exact solution of dz/dt = a·dz(x − z, r) for x held over the sampling period; since
dz(x − z, r) = play(x, r, z) − z, it is a play that is followed with a lag. It needs x(k−1) only, and that makes the
inverse of the whole model explicit.

Source: K. Kuhnen, "Modeling, Identification and Compensation of Complex Hysteretic Nonlinearities: A Modified
Prandtl–Ishlinskii Approach", European Journal of Control 9 (2003) 407–418, and its references for creep.

The ``*_step`` kernels below advance one operator by one sample and are the single source of the operators: batch
simulation, data basis, compensator and learning loop all call them, on floats or on eight operators at once
(`solvers.vector8`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solvers.compiled import kernel

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


@kernel
def play_step(x: float, r: float, z: float) -> float:
    """Output, and new state, of the play operator with threshold r ≥ 0 at the sample x.

    A sample that is NaN leaves the state where it is: max and min return their first argument then.
    """
    return max(min(z, x + r), x - r)


@kernel
def creep_step(x: float, r: float, a: float, z: float) -> float:
    """State of the creep operator one sampling period after x, with a = 1 − e^(−rate·Ts)."""
    return z + a * (play_step(x, r, z) - z)


@kernel
def dead_zone_step(u: float, low: float, high: float) -> float:
    """Output of the dead zone between two limits; one-sided ones have the other limit at infinity."""
    return max(0.0, u - high) + min(0.0, u - low)


@kernel
def _play_batch(x: Vector, r: Vector, z: Vector, out: Matrix) -> None:
    for k in range(x.size):
        for i in range(r.size):
            z[i] = play_step(x[k], r[i], z[i])
            out[k, i] = z[i]


@kernel
def _creep_batch(x: Vector, r: Vector, a: Vector, z: Vector, out: Matrix) -> None:
    for k in range(x.size):
        for i in range(r.size):
            out[k, i] = z[i]
            z[i] = creep_step(x[k], r[i], a[i], z[i])


@kernel
def _dead_zone_batch(u: Vector, low: Vector, high: Vector, out: Matrix) -> None:
    for k in range(u.size):
        for i in range(low.size):
            out[k, i] = dead_zone_step(u[k], low[i], high[i])


def _as_vector(values: ArrayLike) -> Vector:
    return np.ascontiguousarray(values, dtype=np.float64)


def play(x: ArrayLike, thresholds: ArrayLike, state: ArrayLike) -> tuple[Matrix, Vector]:
    """Play operators over an array or a chunk of one.

    Parameters
    ----------
    x : array (N,)
        Input samples.
    thresholds : array (n,)
        One threshold r ≥ 0 for each operator, in the unit of x.
    state : array (n,)
        State of each operator before the first sample; not written to.

    Returns
    -------
    outputs : array (N, n)
    state : array (n,)
        To be handed to the call with the next chunk.

    Examples
    --------
    >>> outputs, state = play([0.0, 2.0, 1.0], [0.5], [0.0])
    >>> outputs.ravel().tolist()
    [0.0, 1.5, 1.5]
    """
    x, r, z = _as_vector(x), _as_vector(thresholds), np.array(state, dtype=np.float64)
    out = np.empty((x.size, r.size))
    _play_batch(x, r, z, out)
    return out, z


def creep(x: ArrayLike, thresholds: ArrayLike, rates: ArrayLike, sample_time: float,
          state: ArrayLike) -> tuple[Matrix, Vector]:
    """Creep operators over an array or a chunk of one.

    Parameters
    ----------
    x : array (N,)
        Input samples.
    thresholds, rates : array (n,)
        Threshold r ≥ 0 in the unit of x and rate a > 0 in 1/s of each operator.
    sample_time : float
        Sampling period in s.
    state : array (n,)
        State of each operator at the first sample; not written to.

    Returns
    -------
    outputs : array (N, n)
        Row k is the state at sample k, which x(k−1) and earlier samples determine.
    state : array (n,)
        The state at the first sample of the next chunk.

    Examples
    --------
    >>> import math
    >>> outputs, state = creep([1.0, 1.0, 1.0], [0.0], [math.log(2.0)], 1.0, [0.0])
    >>> outputs.ravel().round(12).tolist()
    [0.0, 0.5, 0.75]
    """
    x, r, z = _as_vector(x), _as_vector(thresholds), np.array(state, dtype=np.float64)
    out = np.empty((x.size, r.size))
    _creep_batch(x, r, creep_gain(rates, sample_time), z, out)
    return out, z


def creep_gain(rates: ArrayLike, sample_time: float) -> Vector:
    """Return the share 1 − e^(−a·Ts) of its distance that a creep state covers in one sampling period."""
    return -np.expm1(-_as_vector(rates) * sample_time)


def dead_zone(u: ArrayLike, thresholds: ArrayLike) -> Matrix:
    """One-sided dead zones over an array.

    Parameters
    ----------
    u : array (N,)
    thresholds : array (n,)
        Of either sign or zero, in the unit of u.

    Returns
    -------
    array (N, n)

    Examples
    --------
    >>> dead_zone([-2.0, 0.5, 2.0], [-1.0, 0.0, 1.0]).tolist()
    [[-1.0, -2.0, 0.0], [0.0, 0.5, 0.0], [0.0, 2.0, 1.0]]
    """
    u = _as_vector(u)
    low, high = dead_zone_limits(thresholds)
    out = np.empty((u.size, low.size))
    _dead_zone_batch(u, low, high, out)
    return out


def dead_zone_limits(thresholds: ArrayLike) -> tuple[Vector, Vector]:
    """Return the limits (low, high) between which one-sided dead zones of the given thresholds are zero."""
    r = _as_vector(thresholds)
    return np.where(r > 0.0, -np.inf, r), np.where(r < 0.0, np.inf, r)
