"""Bouc-Wen hysteresis with creep.

    Γ[u] = u − h / k,   dh = A du − β |du| |h|^(n−1) h − γ du |h|^n

(Y.-K. Wen, "Method for random vibration of hysteretic systems", Journal of the Engineering Mechanics Division 102
(1976), 249-263; for piezo actuators T. S. Low and W. Guo, "Modeling of a three-layer piezoelectric bimorph beam with
hysteresis", Journal of Microelectromechanical Systems 4 (1995), 230-237). The equation is independent of the
speed of u. It stores no turning points, so it violates the wiping-out law: a minor loop does not close at once but
drifts from cycle to cycle, unlike any superposition of plays or relays.

With |γ| ≤ β the slope dh/du lies between 0 and 2 A β / (β + γ), and h between −A (1 − u) and A (1 + u). For k above
that slope Γ is therefore strictly monotone on every branch, and |Γ| ≤ 1. Only small strokes about an end come near
to 1, after many cycles; the major loop takes about 0.8 of ``y_range``.
"""

from dataclasses import dataclass

import numpy as np

from piezo_model import checks
from piezo_model.core import bindings
from piezo_model.plants.actuator import Actuator, Memory, along
from solvers.arrays import Vector


@dataclass(kw_only=True, eq=False)
class BoucWen(Actuator):
    """The Bouc-Wen actuator of the module, in V and µm.

    Parameters
    ----------
    stiffness : float
        k, above 2 A β / (β + γ).
    loading_slope : float
        A, positive.
    beta, gamma : float
        β and γ, with β > 0 and −β < γ ≤ β.
    exponent : float
        n, at least 1.

    Examples
    --------
    >>> from piezo_model import plants
    >>> plant = plants.get("bouc_wen")
    >>> up, top, down = plant.run([75.0, 150.0, 75.0])
    >>> bool(up < down < top)
    True
    """

    stiffness: float = 1.0
    loading_slope: float = 0.32
    beta: float = 1.5
    gamma: float = 1.0
    exponent: float = 1.2

    def _build(self) -> None:
        A, beta, gamma = self.loading_slope, self.beta, self.gamma
        checks.positive(loading_slope=A, beta=beta)
        checks.require(lambda value: -beta < value <= beta, f"above -beta and at most beta = {beta}", gamma=gamma)
        checks.require(lambda value: 1.0 <= value < np.inf, "at least 1", exponent=self.exponent)
        steepest = 2.0 * A * beta / (beta + gamma)
        checks.require(
            lambda value: steepest < value < np.inf,
            f"above 2 A beta / (beta + gamma) = {steepest}",
            stiffness=self.stiffness,
        )

    def _rest(self) -> Memory:
        memory = {"h": np.zeros(1), "u_before": np.zeros(1), **self._rest_of_log_creep()}
        self._h(np.array([1.0, -1.0] * 20), memory)  # these cycles leave no trace of the virgin state
        return memory

    def _respond(self, u: Vector) -> Vector:
        return self._with_log_creep(u - self._h(u, self._memory) / self.stiffness, u)

    def _h(self, u: Vector, memory: Memory) -> Vector:
        parameters = self.loading_slope, self.beta, self.gamma, self.exponent
        return along(bindings.bouc_wen, u, *parameters, memory["h"], memory["u_before"])
