"""Base of the simulated actuators: ranges, creep, rest, and the coordinates u and v.

    u = (x − x_c) / (Δx / 2) ∈ [−1, 1],   v = Γ[u] ∈ [−1, 1],   y = y_c + v · Δy / 2

with x_c, y_c the centres and Δx, Δy the widths of the ranges. The actuators are written in u and v, where all
parameters are dimensionless, and each is normalised so that |v| ≤ 1 for any drive: y never leaves ``y_range`` by more
than rounding.

Creep that grows like log t is a sum of first-order lags whose rates are spread over decades,

    z_j(k) = z_j(k−1) + (1 − e^(−a_j Ts)) (u(k−1) − z_j(k−1)),   K[u] = (1/J) Σ_j z_j

(K. Kuhnen, H. Janocha, "Inverse feedforward controller for complex hysteretic nonlinearities in smart-material
systems", Control and Intelligent Systems 29 (2001), 74-83, with threshold 0).
"""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_model import checks
from piezo_model.core import bindings
from piezo_model.operators import creep_gain
from piezo_model.plants.protocol import Plant
from solvers.arrays import Vector

Memory = dict[str, NDArray[np.float64]]
"""States of hysteresis and creep by name, in the coordinate u."""


def along(function: Callable[..., object], u: Vector, *arguments: object) -> Vector:
    """Output (N,) of a function of the core for u (N,); the function updates the states among its arguments."""
    output = np.empty_like(u)
    function(u, *arguments, output)
    return output


def curved(v: Vector, saturation: float, asymmetry: float) -> Vector:
    """S(v) = (v − c v³ + e (v² − 1)) / (1 − c), strictly increasing from −1 to 1 over v (N,) in [−1, 1]; ValueError if
    c and e violate that."""
    c, e = saturation, asymmetry
    if not (c >= 0.0 and 1.0 - 2.0 * abs(e) - 3.0 * c > 0.0):
        raise ValueError(
            f"saturation must be at least 0 and 1 - 2 |asymmetry| - 3 saturation above 0, not with saturation {c} and "
            f"asymmetry {e}"
        )
    # Products, since numpy rounds powers of a single number and of an array differently.
    return (v - c * v * v * v + e * (v * v - 1.0)) / (1.0 - c)


@dataclass(kw_only=True, eq=False)
class Actuator(Plant):
    """A simulated actuator in the coordinates of the module.

    Parameters
    ----------
    x_range, y_range : (float, float)
        Drive in V and displacement in µm.
    sample_time : float
        Sampling period, s.
    creep_share : float
        Fraction of the displacement that is creep, from 0 (none) to below 1.
    creep_rates_per_s : tuple of float
        Rates a_j of the creep, 1/s.

    Raises
    ------
    ValueError
        If an option is out of range; the message names it.
    """

    x_range: tuple[float, float] = (0.0, 150.0)
    y_range: tuple[float, float] = (-20.0, 20.0)
    sample_time: float = 125e-6
    creep_share: float = 0.04
    creep_rates_per_s: tuple[float, ...] = (100.0, 10.0, 1.0, 0.1)
    _memory: Memory = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the options, compute the parameters and reset the state."""
        checks.ascending(x_range=self.x_range, y_range=self.y_range)
        checks.positive(sample_time=self.sample_time)
        checks.share(creep_share=self.creep_share)
        checks.require(
            lambda rates: len(rates) > 0 and all(0.0 < rate < np.inf for rate in rates),
            "one or more positive numbers",
            creep_rates_per_s=self.creep_rates_per_s,
        )
        self._a = creep_gain(self.creep_rates_per_s, self.sample_time)
        self._build()
        self.reset()

    @abstractmethod
    def _build(self) -> None:
        """Check the options of the subclass and compute its parameters."""

    @abstractmethod
    def _rest(self) -> Memory:
        """Return the memory of an actuator settled at u = −1, with v near −1, after u = 1."""

    @abstractmethod
    def _respond(self, u: Vector) -> Vector:
        """Return v (N,) for u (N,), advancing the memory in place."""

    def run(self, x: ArrayLike) -> Vector:
        """Continue with a drive; see :meth:`Plant.run`."""
        (x,) = checks.vectors(x=x)
        checks.finite_arrays(x=x)
        (x_low, x_high), (y_low, y_high) = self.x_range, self.y_range
        u = np.clip((x - 0.5 * (x_low + x_high)) / (0.5 * (x_high - x_low)), -1.0, 1.0)
        return np.asarray(0.5 * (y_low + y_high) + 0.5 * (y_high - y_low) * self._respond(u))

    def _with_log_creep(self, hysteresis: Vector, u: Vector) -> Vector:
        """Add the creep of the module to the output of a hysteresis operator, (N,) in [−1, 1]."""
        z = np.empty((u.size, self._a.size))
        bindings.creep(u, np.zeros(self._a.size), self._a, self._memory["z_creep"], z)
        # Rate by rate, so that chunks of any size give the same bits.
        return (1.0 - self.creep_share) * hysteresis + self.creep_share * (sum(z.T) / self._a.size)

    def _rest_of_log_creep(self) -> Memory:
        return {"z_creep": np.full(self._a.size, -1.0)}

    def reset(self) -> None:
        """Go to rest at the low end of the drive."""
        self._memory = self._rest()
