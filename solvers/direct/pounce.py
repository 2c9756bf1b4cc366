"""POUNCE: interior point method, a descendant of Ipopt written in Rust; here its solver of convex quadratic programs.

    minimise ½ xᵀP x + cᵀx   subject to   A x = b,  G x ≤ h,  lb ≤ x ≤ ub;   c = q

Source: J. Kitchin, the package pounce-solver.

Timed: ``update`` copies; ``solve`` is the library's function, which converts P to triplets in Python, sets up and
iterates. Its test that P is positive semidefinite (eigenvalues at every call) is off. There is no warm start: the
library takes whole solutions of a nearby problem, not points.
"""

import numpy as np
import pounce

from solvers.adapter import LibrarySolver, Program, Report, Stack, Vector
from solvers.backend import Backend, relative


class Pounce(LibrarySolver):
    """The library's ``solve_qp``."""

    library = Backend("interior point", "EPL-2.0", "pounce-solver", {"tol": relative}, (4, 6, 8, 10, 12, 13, 14, 15.5))

    def build(self, p: Program, rows: Stack) -> None:
        self._constraints = {name: getattr(p, name) for name in ("A", "b", "G", "h", "lb", "ub")}

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._result = pounce.solve_qp(
            self.program.P, self.program.q, **self._constraints, check_psd=False, **self.settings
        )
        return self._result.x if self._result.status == "optimal" else None

    def report(self) -> Report:
        r = self._result
        return Report(r.x, np.concatenate([np.subtract(r.z_ub, r.z_lb), r.y, r.z]), r.status, r.iters)
