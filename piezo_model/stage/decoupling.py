"""The decoupling matrix of a two-axis stage from a recording in which both axes move.

With y = C p the measured platform and p_i what axis i does, p_i depends on x_i alone. Hence there is exactly one number
c₁₂ = C₁₂ / C₂₂ for which y₁ − c₁₂ y₂ depends on x₁ alone, and least squares finds it beside the weights of any
operators Φ of x₁ that are rich enough:

    y₁(k) ≈ c₁₂ y₂(k) + Φ[x₁](k) a,   and with 1 and 2 exchanged c₂₁;   D = ((1, c₁₂), (c₂₁, 1))⁻¹

D C is diagonal. Its diagonal, the gains C₁₁ and C₂₂, is not known apart from those of the actuators and stays with
them. Φ holds plays, creep, powers and derivatives; what they miss does not disturb c₁₂ unless it goes along with y₂.
"""

import numpy as np
from numpy.typing import ArrayLike

from piezo_model.operators import creep, play
from solvers.arrays import Matrix, Vector

PLAYS = 16
RATES_PER_RECORDING = (1.0, 10.0, 100.0)
"""Creep rates, over one in the whole recording."""
ROWS = 10_000
"""Largest number of samples in the fit; the operators process all samples."""
REMEDY = "drive the two axes independently"
REGULAR = 100.0
"""Largest condition number of a coupling that is accepted."""
INDEPENDENT = 1e-3
"""Smallest share of the variance of one output that the other drive must not explain."""


def estimate_decoupling(x: ArrayLike, y: ArrayLike) -> Matrix:
    """Find D (2, 2), which makes D y a pair of outputs that each follow from one drive.

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
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if x.ndim != 2 or x.shape[1:] != (2,) or x.shape != y.shape:
        raise ValueError(f"x and y must both be of shape (N, 2), not {x.shape} and {y.shape}")
    for name, values in (("x", x), ("y", y)):
        if not np.isfinite(values).all():
            raise ValueError(
                f"{name} has a value at sample {np.argwhere(~np.isfinite(values))[0, 0]} that is not finite"
            )
    if len(x) < 10 * PLAYS:
        raise ValueError(f"{len(x)} samples are too few to tell the axes apart; it takes at least {10 * PLAYS}")
    for i in range(2):
        if np.ptp(x[:, i]) == 0.0:
            raise ValueError(f"the drive of axis {i} does not move in the recording, so its coupling cannot be seen")
    C = np.array([[1.0, _crosstalk(x, y, 0)], [_crosstalk(x, y, 1), 1.0]])
    if np.linalg.cond(C) > REGULAR:
        raise ValueError(f"the recording makes the two displacements nearly the same, coupling {C.tolist()}; {REMEDY}")
    D: Matrix = np.linalg.inv(C)
    return D


def _crosstalk(x: Matrix, y: Matrix, axis: int) -> float:
    """The c for which y_axis − c y_other depends on x_axis alone."""
    chosen = slice(None, None, -(-len(x) // ROWS))
    own, other = (values[chosen] - values[chosen].mean() for values in (y[:, axis], y[:, 1 - axis]))
    basis = np.linalg.qr(_operators(x[:, axis])[chosen])[0]
    open_part = other - basis @ (basis.T @ other)
    if not open_part @ open_part > INDEPENDENT * (other @ other):
        raise ValueError(
            f"the displacement {1 - axis} follows from the drive of axis {axis} in this recording; {REMEDY}"
        )
    return float(open_part @ own / (open_part @ open_part))


def _operators(x: Vector) -> Matrix:
    """Columns (N, 6 + PLAYS + rates) of what one drive can do; speed and acceleration stand for lag and inertia."""
    u = (2.0 * x - x.max() - x.min()) / np.ptp(x)
    thresholds = np.arange(1, PLAYS + 1) / (PLAYS + 1)
    plays = play(u, thresholds, np.full(PLAYS, u[0]))[0]
    rates = np.array(RATES_PER_RECORDING) / u.size
    creeps = creep(u, np.zeros(rates.size), rates, 1.0, np.full(rates.size, u[0]))[0]
    speed = np.gradient(u)
    return np.column_stack([np.ones(u.size), u, u**2, u**3, speed, np.gradient(speed), plays, creeps])
