"""HPIPM: interior point method, reached through CasADi as an optimal control problem of one stage.

    minimise ½ xᵀP x + qᵀx   subject to   l ≤ R x ≤ u,  lb ≤ x ≤ ub

Source: G. Frison, M. Diehl, "HPIPM: a high-performance quadratic programming framework for model predictive control",
IFAC-PapersOnLine 53 (2020), pages 6563 to 6569.

Timed: ``solve`` is a call of the function with our arrays, which it converts: with the buffer of
:mod:`solvers.direct._casadi` the plugin would use the first data for all solves. The plugin takes control problems
only: our problem is a stage without dynamics whose state is x; if the stage is not specified, the plugin ends the
process. It replaces infinite bounds by 1e8, which keeps residuals above 1e-9 by rounding alone; our settings replace it
by 1e6, so every |x_i| must be far below that. The settings are those of HPIPM itself: ``res_g_max``, ``res_b_max``,
``res_d_max``, ``res_m_max`` bound the four residuals. The lower limit of the multipliers, 1e-16 by default, times 1e6
exceeds the complementarity that the rungs from 10⁻¹⁰ allow, so it is 1e-30.
"""

from typing import Any

from solvers.backend import HPIPM
from solvers.direct._casadi import Conic
from solvers.protocol import Vector


class CasadiHpipm(Conic):
    """``casadi.conic`` with the plugin hpipm."""

    library = HPIPM
    plugin = "hpipm"

    def options(self, d: int, m: int) -> dict[str, Any]:
        infinity = 1e6 if self.settings else 1e8
        return {"N": 0, "nx": [d], "nu": [0], "ng": [m], "inf": infinity, "hpipm": self.settings}

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        p = self.program
        data = {**self._held, "h": p.P, "a": p.R[p.general]}
        result = self._function(**{key: array for key, array in data.items() if array.size})
        self._x[:] = result["x"].full().ravel()
        self._w[p.bounds], self._w[p.general] = (result[key].full().ravel() for key in ("lam_x", "lam_a"))
        self._stats = self._function.stats()
        return self._x if self._stats["success"] else None
