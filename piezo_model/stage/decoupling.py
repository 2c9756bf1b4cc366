"""Estimation of the decoupling matrix of a two-axis stage from a recording in which both axes move.

The measured displacement is y = C p, where the displacement p_i of axis i depends on the drive x_i alone. Hence
y₁ − c₁₂ y₂ depends on x₁ alone for exactly one number, c₁₂ = C₁₂ / C₂₂. Least squares estimates it together with the
weights a of sufficiently many operators Φ of x₁:

    y₁(k) ≈ c₁₂ y₂(k) + Φ[x₁](k) a,   likewise c₂₁ with the axes exchanged;   D = ((1, c₁₂), (c₂₁, 1))⁻¹

D C is diagonal. The diagonal, C₁₁ and C₂₂, cannot be separated from the gains of the actuators and remains part of
them. Φ consists of plays, creep, powers and derivatives; an error of this approximation biases c₁₂ only if it is
correlated with y₂.
"""

import numpy as np
from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.operators import creep, play
from solvers.arrays import Matrix, Vector

PLAYS = 16
RATES_PER_RECORDING = (1.0, 10.0, 100.0)
"""Creep rates as multiples of the inverse duration of the recording."""
ROWS = 10_000
"""Largest number of samples in the fit; the operators process all samples."""
REMEDY = "drive the two axes independently"
LARGEST_CONDITION = 100.0
"""Largest accepted condition number of the estimated coupling."""
INDEPENDENT_SHARE = 1e-3
"""Smallest accepted share of the variance of one output that the drive of the other axis leaves unexplained."""


def estimate_decoupling(x: ArrayLike, y: ArrayLike) -> Matrix:
    """Estimate D (2, 2) such that each of the two outputs D y depends on one drive.

    Parameters
    ----------
    x, y : array (N, 2)
        Drives and measured displacements, in any units; both axes move, and not in the same way.

    Returns
    -------
    array (2, 2)

    Raises
    ------
    ValueError
        If the recording does not determine the coupling; the message has the reason.

    Examples
    --------
    >>> k = np.arange(5000)
    >>> p = np.column_stack([np.sin(k / 50), np.cos(k / 83)])
    >>> C = np.array([[1.0, 0.05], [-0.03, 1.0]])
    >>> D = estimate_decoupling(p, p @ C.T)
    >>> bool(np.allclose(D @ C, np.eye(2), atol=1e-9))
    True
    """
    x, y = checks.columns(2, x=x, y=y)
    checks.finite_arrays(x=x, y=y)
    if len(x) < 10 * PLAYS:
        raise ValueError(f"{len(x)} samples are too few to tell the axes apart; it takes at least {10 * PLAYS}")
    for i in range(2):
        if np.ptp(x[:, i]) == 0.0:
            raise ValueError(f"the drive of axis {i} does not move in the recording, so its coupling cannot be seen")
    C = np.array([[1.0, _crosstalk(x, y, 0)], [_crosstalk(x, y, 1), 1.0]])
    if np.linalg.cond(C) > LARGEST_CONDITION:
        raise ValueError(f"the recording makes the two displacements nearly the same, coupling {C.tolist()}; {REMEDY}")
    return np.asarray(np.linalg.inv(C))


def _crosstalk(x: Matrix, y: Matrix, axis: int) -> float:
    """The factor c for which y_axis − c y_other depends on x_axis alone."""
    rows = slice(None, None, -(-len(x) // ROWS))
    own, other = (values[rows] - values[rows].mean() for values in (y[:, axis], y[:, 1 - axis]))
    basis = np.linalg.qr(_operators(x[:, axis])[rows])[0]
    residual = other - basis @ (basis.T @ other)
    if not residual @ residual > INDEPENDENT_SHARE * (other @ other):
        raise ValueError(
            f"the displacement {1 - axis} follows from the drive of axis {axis} in this recording; {REMEDY}"
        )
    return float(residual @ own / (residual @ residual))


def _operators(x: Vector) -> Matrix:
    """Operators Φ[x] (N, 6 + PLAYS + rates) of one drive; speed and acceleration represent lag and inertia."""
    u = (2.0 * x - x.max() - x.min()) / np.ptp(x)
    thresholds = np.arange(1, PLAYS + 1) / (PLAYS + 1)
    plays = play(u, thresholds, np.full(PLAYS, u[0]))[0]
    rates = np.array(RATES_PER_RECORDING) / u.size
    creeps = creep(u, np.zeros(rates.size), rates, 1.0, np.full(rates.size, u[0]))[0]
    speed = np.gradient(u)
    return np.column_stack([np.ones(u.size), u, u**2, u**3, speed, np.gradient(speed), plays, creeps])
