"""One axis of a stage up to its platform: actuators, their drift, the lever and the structure; itself a plant.

    one actuator         f(k) = y_c + g(k Ts) (Γ[x](k) − y_c)
    push-pull            f(k) = ½ g(k Ts) (Γ₁[x](k) − Γ₂[2 x_c − x](k)),   x_c the bias, the centre of the drive
    lever and structure  z̈ + 2 ζ ω ż + ω² z = ω² ℓ f(k)   while f(k) is held,   p(k) = z(k Ts + Ts)

With two equal actuators the sum is an odd function about the bias: an even part of Γ, which shifts or bends the loop,
cancels. The gain g drifts with temperature and age (`sensor`), ℓ is the ratio of the lever, and a solid-state stage is
a linear structure (the paper's introduction). Its response to a held input is computed exactly: with s = (z, ż/ω) the
deviation from rest obeys ds/dt = ω A s, A = ((0, 1), (−1, −2ζ)), so that

    s(k+1) − s∞ = e^(ω Ts A) (s(k) − s∞),   s∞ = (ℓ f(k), 0)

(K. J. Åström and B. Wittenmark, "Computer-Controlled Systems", 3rd ed., 1997, section 2.3). A sample is taken at the
end of the period in which its drive was held, so p(k) is the answer to x[0..k].
"""

import copy
import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from piezo_model import checks
from piezo_model.core import bindings
from piezo_model.plants.actuator import Actuator, along
from piezo_model.plants.protocol import Plant
from piezo_model.plants.sensor import gain_from
from solvers.arrays import Vector

FOREVER_S = 1e12
"""Sampling period after which all creep has settled; the states of an actuator do not depend on its sampling period."""


@dataclass(kw_only=True, eq=False)
class Axis(Plant):
    """The axis of the module: drive in V, displacement of the platform in µm.

    Parameters
    ----------
    actuators : one or two Actuator
        Two are driven in push-pull and must have the same ranges and sampling period. They must not be driven in any
        other way afterwards.
    lever : float
        ℓ, displacement of the platform over that of the actuator.
    natural_frequency_Hz, damping_ratio : float
        ω / 2π and ζ, at least 0.
    gain_drift_per_s : float
        Ageing: the rate at which g changes, 1/s.
    gain_swing, gain_swing_period_s : float
        Temperature: amplitude (a pure number) and period (s) of a sine in g.

    Raises
    ------
    ValueError
        If an option is out of range; the message names it.

    Examples
    --------
    >>> from piezo_model import plants
    >>> pair = Axis(actuators=tuple(plants.get("relay_preisach", creep_share=0.0) for _ in range(2)), lever=2.0)
    >>> pair.y_range
    (-40.0, 40.0)
    >>> low, high = pair.run([0.0] * 800 + [150.0] * 800)[[799, 1599]]
    >>> bool(abs(low + high) < 1e-6 * (high - low))
    True
    """

    actuators: tuple[Actuator, ...]
    lever: float = 1.0
    natural_frequency_Hz: float = 800.0
    damping_ratio: float = 0.1
    gain_drift_per_s: float = 0.0
    gain_swing: float = 0.0
    gain_swing_period_s: float = 60.0

    def __post_init__(self) -> None:
        """Check the options and go to rest."""
        if len(self.actuators) not in (1, 2):
            raise ValueError(f"an axis has one actuator or two in push-pull, not {len(self.actuators)}")
        if len({id(actuator) for actuator in self.actuators}) != len(self.actuators):
            raise ValueError("the two actuators of an axis must be two objects, since each has a memory of its own")
        first = self.actuators[0]
        for option in ("x_range", "y_range", "sample_time"):
            values = [getattr(actuator, option) for actuator in self.actuators]
            if values[0] != values[-1]:
                raise ValueError(
                    f"the actuators in push-pull must have the same {option}, not {values[0]} and {values[1]}"
                )
        checks.positive(
            lever=self.lever,
            natural_frequency_Hz=self.natural_frequency_Hz,
            gain_swing_period_s=self.gain_swing_period_s,
        )
        checks.not_negative(damping_ratio=self.damping_ratio)
        checks.finite(gain_drift_per_s=self.gain_drift_per_s, gain_swing=self.gain_swing)
        self.x_range, self.sample_time = first.x_range, first.sample_time
        low, high = first.y_range
        self._centre = 0.0 if self.push_pull else 0.5 * (low + high)
        half = 0.5 * (high - low)
        self.y_range = (self.lever * (self._centre - half), self.lever * (self._centre + half))
        angle = 2.0 * math.pi * self.natural_frequency_Hz * self.sample_time
        self._F = np.ascontiguousarray(expm(angle * np.array([[0.0, 1.0], [-1.0, -2.0 * self.damping_ratio]])))
        self.reset()

    @property
    def push_pull(self) -> bool:
        """Whether two opposing actuators drive the axis."""
        return len(self.actuators) == 2

    def run(self, x: ArrayLike) -> Vector:
        """Continue with a drive; see :meth:`Plant.run`."""
        x = np.asarray(x, dtype=np.float64)
        force = self._force(x)
        drift = self.gain_drift_per_s, self.gain_swing, self.gain_swing_period_s
        gain = gain_from(self._samples, force.size, self.sample_time, *drift)
        self._samples += force.size
        drifted = self.lever * (self._centre + gain * (force - self._centre))
        return along(bindings.structure_response, drifted, self._F, self._structure)

    def _force(self, x: Vector) -> Vector:
        """Displacement of the actuators, before drift, lever and structure."""
        pushed = self.actuators[0].run(x)
        return 0.5 * (pushed - self.actuators[1].run(sum(self.x_range) - x)) if self.push_pull else pushed

    def reset(self) -> None:
        """Go to rest at the low end of the drive, time zero; an opposing actuator is then settled at its high end."""
        for actuator in self.actuators:
            actuator.reset()
        if self.push_pull:
            settled = dataclasses.replace(self.actuators[1], sample_time=FOREVER_S)
            settled.run(np.full(3, self.x_range[1]))
            self.actuators[1]._memory = settled._memory
        at_rest = copy.deepcopy(self)._force(np.full(1, self.x_range[0]))[0]
        self._samples, self._structure = 0, np.array([self.lever * at_rest, 0.0])
