"""Duhem hysteresis after Coleman and Hodgdon, with a cubic saturation and creep.

    dv = α |du| (u − v) + b du,   Γ[u] = S(v / v_1)

(B. D. Coleman and M. L. Hodgdon, "A constitutive relation for rate-independent hysteresis in ferromagnetically soft
materials", International Journal of Engineering Science 24 (1986), 897-919.) The deviation e = v − u goes to
∓(1 − b) / α as u rises or falls and is exact over any step, e ← e_∞ + (e − e_∞) e^(−α |Δu|). With ½ < b ≤ 1 every
branch rises. Turning points fade with the distance that u travels instead of being wiped out, so minor loops do not
close. S is the cubic of `actuator.curved`, v_1 = 1 + (1 − b) / α an upper bound of |v|.
"""

from dataclasses import dataclass

import numpy as np

from piezo_model import checks
from piezo_model.core import bindings
from piezo_model.plants.actuator import Actuator, Memory, along, curved
from solvers.arrays import Vector


@dataclass(kw_only=True, eq=False)
class Duhem(Actuator):
    """The Duhem actuator of the module, in V and µm.

    Parameters
    ----------
    alpha : float
        α, positive: inverse of the travel over which a turning point fades, in half ranges of the drive.
    slope_after_turn : float
        b, above 0.5 and below 1: the slope is about 1 after long travel in one direction and 2 b − 1 after a turning
        point.
    saturation, asymmetry : float
        c and e of the cubic.

    Examples
    --------
    >>> from piezo_model import plants
    >>> plant = plants.get("duhem")
    >>> up, top, down = plant.run([75.0, 150.0, 75.0])
    >>> bool(up < down < top)
    True
    """

    alpha: float = 4.5
    slope_after_turn: float = 0.52
    saturation: float = 0.05
    asymmetry: float = 0.05

    def _build(self) -> None:
        checks.positive(alpha=self.alpha)
        checks.between(0.5, 1.0, slope_after_turn=self.slope_after_turn)
        curved(np.zeros(1), self.saturation, self.asymmetry)
        # |e| ≤ (1 − b) / α for any drive, and |v| ≤ 1 + |e|.
        self._half = 1.0 + (1.0 - self.slope_after_turn) / self.alpha

    def _rest(self) -> Memory:
        memory = {"e": np.zeros(1), "u_before": np.zeros(1), **self._rest_of_log_creep()}
        self._deviation(np.array([1.0, -1.0] * 20), memory)
        return memory

    def _respond(self, u: Vector) -> Vector:
        e = self._deviation(u, self._memory)
        return self._with_log_creep(curved((u + e) / self._half, self.saturation, self.asymmetry), u)

    def _deviation(self, u: Vector, memory: Memory) -> Vector:
        return along(bindings.deviation, u, self.alpha, self.slope_after_turn, memory["e"], memory["u_before"])
