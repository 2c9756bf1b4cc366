"""Parameters θ of the dynamics as unknowns of the forward fit, with their bounds.

    θ = (log f_1, log f_2/f_1, log ζ_i; sum of the gains, share of the second; delay, and that of the amplifier)

with delays in samples, so that every θ in a box is a valid stage. Frequencies, or their ratio, stay within 2 % (or 0.3
of the damping ratio, if that is more) of those of the scan, and damping ratios within a factor of 1.5, since the output
error has local minima between the harmonics of a drive. A single mode has gain 1 unless there is residual compliance.
The amplifier delays a ramp by 1 / (exp(T/T_a) − 1) samples, which, unlike T_a, has a derivative at zero lag.
"""

import math
from dataclasses import dataclass

import numpy as np

from piezo_model.dynamics import Dynamics
from solvers.arrays import Mask, Matrix, Vector

FREQUENCY_RATIO, OF_DAMPING, DAMPING_RATIO, LONGEST = 1.02, 0.3, 1.5, 20.0
"""The bounds above, and the longest delay and lag, in samples."""
SMALLEST_GAIN, MOST_DAMPED, APART = 0.01, 0.99, 2e-3
"""Smallest gain, largest damping ratio, and smallest difference of the logarithms of two frequencies."""
STEP, ROUNDING = 1e-5, 1e-7
"""Step of a finite difference; tolerance with which a sum of gains is 1, and a delay in samples is 0."""


@dataclass(frozen=True)
class Parameters:
    """The dynamics ``start``, and which of their parameters are unknowns: none by default; with ``free`` modes and
    delay, with ``residual`` also the gains, and with ``with_lag`` the lag of the amplifier."""

    start: Dynamics
    sample_time: float
    free: bool = False
    residual: bool = False
    with_lag: bool = False

    @property
    def vector(self) -> Vector:
        """θ of the start, shape (k,)."""
        g, T = self.start, self.sample_time
        if not self.free:
            return np.zeros(0)
        gains = [sum(g.gains), *(gain / sum(g.gains) for gain in g.gains[1:])] if self.residual else []
        late, f = [g.amplifier_samples(T)] * self.with_lag, np.diff(np.log(g.frequencies_Hz), prepend=0.0)
        return np.array([*f, *np.log(g.damping), *gains, g.delay_s / T, *late])

    @property
    def bounds(self) -> tuple[Vector, Vector]:
        """Bounds (k,) of θ."""
        theta, modes = self.vector, len(self.start.frequencies_Hz) * self.free
        gains, widths = modes * self.residual, OF_DAMPING * np.array(self.start.damping[:modes])
        near = np.r_[np.maximum(np.log(FREQUENCY_RATIO), widths), np.full(modes, np.log(DAMPING_RATIO))]
        centre, late = theta[: near.size], theta.size - near.size - gains
        lb, ub = centre - near, np.minimum(centre + near, np.repeat([np.inf, np.log(MOST_DAMPED)], modes))
        lb[1:modes] = np.maximum(lb[1:modes], APART)
        gains_ub = [1.0, 1.0 - SMALLEST_GAIN][:gains]
        return np.r_[lb, np.full(gains, SMALLEST_GAIN), np.zeros(late)], np.r_[ub, gains_ub, np.full(late, LONGEST)]

    @property
    def _delay(self) -> int:
        """Number of the delay in θ."""
        return len(self.start.frequencies_Hz) * (3 if self.residual else 2)

    def deviations(self, covariance: Matrix) -> Vector:
        """Standard deviations of log f_i, log ζ_i and the delay in samples, from the covariance (k, k) of θ."""
        modes, T = len(self.start.frequencies_Hz) * self.free, np.eye(len(covariance))
        T[:modes, :modes] = np.tril(np.ones((modes, modes)))
        return np.asarray(np.sqrt(np.diag(T @ covariance @ T.T)))[[*range(2 * modes), self._delay]]

    def inside(self, dynamics: Dynamics, free: Mask) -> bool:
        """True if no parameter is at a bound of the search; ``free`` (k,) are those at no bound. Since there are stages
        without residual compliance or delay, a sum of the gains of 1 and a delay of 0 do not count as bounds."""
        inside = free.copy()
        if self.residual:
            inside[2 * len(dynamics.frequencies_Hz)] |= sum(dynamics.gains) > 1.0 - ROUNDING
        inside[self._delay] |= dynamics.delay_s <= ROUNDING * self.sample_time
        return bool(np.all(inside))

    def at(self, theta: Vector) -> Dynamics:
        """The dynamics of a θ (k,) within the bounds."""
        if not self.free:
            return self.start
        modes, T = len(self.start.frequencies_Hz), self.sample_time
        f, zeta, rest = np.exp(np.cumsum(theta[:modes])), np.exp(theta[modes : 2 * modes]), theta[2 * modes :].tolist()
        gains = self.start.gains
        if self.residual:
            total, *second = [rest.pop(0) for _ in range(modes)]
            gains = (total - total * sum(second), *(total * share for share in second))
        lag = self.start.amplifier_lag_s
        if self.with_lag:
            lag = T / math.log1p(1.0 / rest[1]) if rest[1] > 0.0 else 0.0
        return Dynamics(tuple(f), tuple(zeta), gains, T * rest[0], lag)
