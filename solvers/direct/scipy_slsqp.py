"""Sequential least squares programming (SciPy's SLSQP), which builds a quasi-Newton approximation of P of its own.

    minimise ½ xᵀP x + qᵀx   subject to   A x − b = 0,  h − G x ≥ 0,  lb ≤ x ≤ ub

Source: D. Kraft, "A software package for sequential quadratic programming", report DFVLR-FB 88-28 (1988).

Timed: ``solve`` is everything, cost and rows being called from Python at every step. ``ftol`` is an absolute tolerance
on the cost, so the error of x goes with its square root. The library's Lagrangian is the cost minus multipliers times
rows; the duals of the bounds, which it does not give, follow from stationarity.
"""

from functools import partial

import numpy as np
from qpsolvers import Problem, Solution
from scipy.optimize import Bounds, minimize

from solvers.backend import Backend, LibrarySolver, absolute
from solvers.direct._box import bound_duals, cost, inside, refuse_crossing
from solvers.protocol import Vector
from solvers.rows import Program


class ScipySlsqp(LibrarySolver):
    """scipy.optimize.minimize(method="SLSQP")."""

    name = "scipy_slsqp"
    library = Backend(
        "sequential least squares",
        "BSD-3-Clause",
        "scipy",
        {"ftol": absolute},
        (4, 6, 8, 10, 12, 14, 16),
        more={"maxiter": 10_000},
    )
    warm_startable = True

    def setup(self, problem: Problem) -> None:  # noqa: D102
        self.program = p = Program(problem)
        refuse_crossing(p, self.name)
        self._rows = [
            {"type": kind, "fun": lambda x, R=R, r=r: R @ x - r, "jac": lambda x, R=R: R}
            for kind, R, r in (
                ("eq", p.R[p.equalities], p.u[p.equalities]),
                ("ineq", -p.R[p.inequalities], -p.u[p.inequalities]),
            )
            if r.size
        ]

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        lb, ub = self.program.l[self.program.bounds], self.program.u[self.program.bounds]
        self._result = minimize(  # type: ignore[call-overload]
            partial(cost, self.program),
            inside(warm_start, lb, ub),
            jac=True,
            method="SLSQP",
            bounds=Bounds(lb, ub),
            constraints=self._rows,
            options=self.settings,
        )
        x: Vector = self._result.x
        return x if self._result.success else self.program.no_answer()

    def solution(self) -> Solution:  # noqa: D102
        p, r = self.program, self._result
        w = np.zeros(p.u.size)
        w[p.general] = r.multipliers
        w[p.equalities] *= -1.0
        gradient = cost(p, r.x)[1] + p.R.T @ w
        w[p.bounds] = bound_duals(gradient, p.l[p.bounds], p.u[p.bounds])
        return p.solution(r.x, w, bool(r.success), status=r.message, reported_us=None, iterations=int(r.nit))
