"""POUNCE: interior point method, a descendant of Ipopt written in Rust; here its solver of convex quadratic programs.

    minimise ½ xᵀP x + cᵀx   subject to   A x = b,  G x ≤ h,  lb ≤ x ≤ ub;   c = q

Source: J. Kitchin, the package pounce-solver.

Timed: ``update`` copies; ``solve`` is the library's function, which converts P to triplets in Python, sets up and
iterates. Its test that P is positive semidefinite (eigenvalues at every call) is off. There is no warm start: the
library takes whole solutions of a nearby problem, not points.
"""

import numpy as np
import pounce
from qpsolvers import Problem, Solution

from solvers.backend import Backend, LibrarySolver, share
from solvers.protocol import Vector
from solvers.rows import Program


class Pounce(LibrarySolver):
    """The library's ``solve_qp``."""

    name = "pounce"
    library = Backend("interior point", "EPL-2.0", "pounce-solver", {"tol": share}, (4, 6, 8, 10, 12, 13, 14, 15.5))

    def setup(self, problem: Problem) -> None:  # noqa: D102
        self.program = p = Program(problem)
        self._constraints = {
            "A": p.R[p.equalities],
            "b": p.u[p.equalities],
            "G": p.R[p.inequalities],
            "h": p.u[p.inequalities],
            "lb": p.l[p.bounds],
            "ub": p.u[p.bounds],
        }

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        self._result = pounce.solve_qp(
            self.program.P, self.program.q, **self._constraints, check_psd=False, **self.settings
        )
        self._found = self._result.status == "optimal"
        x: Vector = self._result.x
        return x if self._found else self.program.no_answer()

    def solution(self) -> Solution:  # noqa: D102
        r = self._result
        w = np.concatenate([np.subtract(r.z_ub, r.z_lb), r.y, r.z])
        return self.program.solution(
            np.asarray(r.x), w, self._found, status=r.status, reported_us=None, iterations=r.iters
        )
