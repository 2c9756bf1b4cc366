"""The three elementary operators of the modified Prandtl–Ishlinskii model with creep.

With x(k) the input, r a threshold, z a state and Ts the sampling period:

    play          z(k) = max(x(k) − r, min(x(k) + r, z(k−1)))
    dead zone     S_r(u) = max(u − r, 0) for r > 0,  min(u − r, 0) for r < 0,  u for r = 0
    creep         z(k) = z(k−1) + (1 − e^(−a·Ts)) · dz(x(k−1) − z(k−1), r),  dz(u, r) = max(u − r, 0) + min(u + r, 0)

The creep line is the exact solution of dz/dt = a·dz(x − z, r) for x held over the sampling period; since
dz(x − z, r) = play(x, r, z) − z, it is a play that is followed with a lag. It needs x(k−1) only, and that makes the
inverse of the whole model explicit.

Source: K. Kuhnen, "Modeling, Identification and Compensation of Complex Hysteretic Nonlinearities: A Modified
Prandtl–Ishlinskii Approach", European Journal of Control 9 (2003) 407–418, and its references for creep. The arithmetic
is ``core/operators.h``.
"""

import numpy as np
from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.core import bindings
from solvers.arrays import Matrix, Vector, reals


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
        State for the next chunk.

    Examples
    --------
    >>> outputs, state = play([0.0, 2.0, 1.0], [0.5], [0.0])
    >>> outputs.ravel().tolist()
    [0.0, 1.5, 1.5]
    """
    (x,), (r, z) = checks.vectors(x=x), checks.vectors(thresholds=thresholds, state=np.array(state))
    out = np.empty((x.size, r.size))
    bindings.play(x, r, z, out)
    return out, z


def creep(
    x: ArrayLike, thresholds: ArrayLike, rates: ArrayLike, sample_time: float, state: ArrayLike
) -> tuple[Matrix, Vector]:
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
    (x,), (r, z) = checks.vectors(x=x), checks.vectors(thresholds=thresholds, state=np.array(state))
    out = np.empty((x.size, r.size))
    bindings.creep(x, r, creep_gain(rates, sample_time), z, out)
    return out, z


def creep_gain(rates: ArrayLike, sample_time: float) -> Vector:
    """Return the share 1 − e^(−a·Ts) of its distance that a creep state covers in one sampling period."""
    return -np.expm1(-reals("rates", rates) * sample_time)


def dead_zone(u: ArrayLike, thresholds: ArrayLike) -> Matrix:
    """One-sided dead zones over an array.

    Parameters
    ----------
    u : array (N,)
    thresholds : array (n,)
        Thresholds of either sign or zero, in the unit of u.

    Returns
    -------
    array (N, n)

    Examples
    --------
    >>> dead_zone([-2.0, 0.5, 2.0], [-1.0, 0.0, 1.0]).tolist()
    [[-1.0, -2.0, 0.0], [0.0, 0.5, 0.0], [0.0, 2.0, 1.0]]
    """
    u = checks.vectors(u=u)[0][:, None]
    low, high = dead_zone_limits(thresholds)
    return np.fmax(u - high, 0.0) + np.fmin(u - low, 0.0)  # NaN gives 0


def dead_zone_limits(thresholds: ArrayLike) -> tuple[Vector, Vector]:
    """Return the limits (low, high) between which one-sided dead zones of the given thresholds are zero."""
    r = reals("thresholds", thresholds)
    return np.where(r > 0.0, -np.inf, r), np.where(r < 0.0, np.inf, r)
