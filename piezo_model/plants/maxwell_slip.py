"""Maxwell slip: springs that drag sliders with dry friction, in parallel with one spring without a slider.

    u = κ q + Σ_i F_i,   dF_i = k_i dq while |F_i| ≤ f_i,   Γ[u] = S(q)

q is the charge and u the voltage: the Maxwell resistive capacitor of M. Goldfarb and N. Celanovic, "Modeling
piezoelectric stack actuators for control of micromanipulation", IEEE Control Systems 17 (1997), 69-79. The input is the
voltage, so the charge is computed along the linear segments between the points at which sliders begin to move. S is the
cubic of `actuator.curved`.
"""

from dataclasses import dataclass

import numpy as np

from piezo_model import checks
from piezo_model.core import bindings
from piezo_model.plants.actuator import Actuator, Memory, along, curved
from solvers.arrays import Vector


@dataclass(kw_only=True, eq=False)
class MaxwellSlip(Actuator):
    """The Maxwell slip actuator of the module, in V and µm.

    Parameters
    ----------
    sliders : int
        Number of springs with a slider; the last slider begins to move at the extension ``reach``.
    slip_share : float
        Σ k_i / (κ + Σ k_i), above 0 to below 1: the part of the stiffness after a turning point that slipping removes.
    reach : float
        That extension, above 0 to 2, in units of half the drive's range.
    saturation, asymmetry : float
        c and e of the cubic.

    Examples
    --------
    >>> from piezo_model import plants
    >>> plant = plants.get("maxwell_slip")
    >>> up, top, down = plant.run([75.0, 150.0, 75.0])
    >>> bool(up < down < top)
    True
    """

    sliders: int = 10
    slip_share: float = 0.4
    reach: float = 1.2
    saturation: float = 0.08
    asymmetry: float = 0.05

    def _build(self) -> None:
        checks.whole(1, sliders=self.sliders)
        checks.between(0.0, 1.0, slip_share=self.slip_share)
        checks.require(lambda value: 0.0 < value <= 2.0, "above 0 and at most 2", reach=self.reach)
        curved(np.zeros(1), self.saturation, self.asymmetry)
        self._spring = 1.0 - self.slip_share
        self._k = np.full(self.sliders, self.slip_share / self.sliders)
        self._f = self._k * self.reach * np.arange(1, self.sliders + 1) / self.sliders
        self._half = float(np.ptp(self._charge(np.array([1.0, -1.0]), self._unsettled()))) / 2.0

    def _unsettled(self) -> Memory:
        return {"force": np.zeros(self.sliders), "q": np.zeros(1), "u_before": np.zeros(1)}

    def _charge(self, u: Vector, memory: Memory) -> Vector:
        states = memory["force"], memory["q"], memory["u_before"]
        return along(bindings.charge, u, self._spring, self._k, self._f, *states)

    def _rest(self) -> Memory:
        memory = self._unsettled()
        self._charge(np.array([1.0, -1.0]), memory)
        return {**memory, **self._rest_of_log_creep()}

    def _respond(self, u: Vector) -> Vector:
        v = np.clip(self._charge(u, self._memory) / self._half, -1.0, 1.0)
        return self._with_log_creep(curved(v, self.saturation, self.asymmetry), u)
