"""MuJoCo's ``mju_boxQP``: projected Newton method on the variables that no bound holds, with a projected line search.

    minimise ½ xᵀH x + xᵀg   subject to   lower ≤ x ≤ upper;   H = P, g = q

Source: Y. Tassa, N. Mansard, E. Todorov, "Control-limited differential dynamic programming", IEEE International
Conference on Robotics and Automation (2014), section III-C, in the engine of MuJoCo.

Timed: ``update`` copies; ``solve`` is the library's function, which works in our memory. It starts from ``warm_start``
or from 0. Its limits (100 iterations, a squared gradient of 1e-16, a step of 1e-22) cannot be set from Python, so there
is one rung. It reports an indefinite P, but not which limit ended a solve.
"""

import numpy as np
from mujoco import _functions  # the package mujoco-core, which is this without the viewer and its windows

from solvers.adapter import Program, Stack, Vector
from solvers.backend import Backend
from solvers.direct._box import BoxMinimiser, BoxResult


class Mujoco(BoxMinimiser):
    """The library's ``mju_boxQP``."""

    library = Backend("projected Newton", "Apache-2.0", "mujoco-core")
    warm_startable = True
    refuses_fixed = True

    def build(self, p: Program, rows: Stack) -> None:
        super().build(p, rows)
        self._x, self._factor = np.zeros(p.d), np.zeros((p.d, p.d + 7))

    def minimise(self, start: Vector | None) -> BoxResult:
        p, x = self.program, self._x
        x[:] = 0.0 if start is None else start
        return outcome(x, _functions.mju_boxQP(x, self._factor, None, p.P, p.q, self.lb, self.ub))


def outcome(x: Vector, free: int) -> BoxResult:
    """The outcome for the number of free variables that the library returns."""
    return BoxResult(x, free >= 0, f"{free} variables free" if free >= 0 else "P is not positive definite")
