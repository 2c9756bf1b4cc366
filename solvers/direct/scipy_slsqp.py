"""Sequential least squares programming (SciPy's SLSQP), which builds a quasi-Newton approximation of P of its own.

    minimise ½ xᵀP x + qᵀx   subject to   A x − b = 0,  h − G x ≥ 0,  lb ≤ x ≤ ub

Source: D. Kraft, "A software package for sequential quadratic programming", report DFVLR-FB 88-28 (1988).

Timed: ``solve`` is everything, with Python calls of cost and rows at every step. ``ftol`` is an absolute tolerance on
the cost, so the error of x is proportional to its square root. The library's Lagrangian is the cost minus multipliers
times rows; the duals of the bounds, which it does not compute, follow from stationarity.
"""

from functools import partial

import numpy as np
from scipy.optimize import Bounds, minimize

from solvers.adapter import LibrarySolver, Program, Report, Stack, Vector
from solvers.backend import Backend, absolute
from solvers.direct._box import bound_duals, cost, inside


class ScipySlsqp(LibrarySolver):
    """scipy.optimize.minimize(method="SLSQP")."""

    library = Backend(
        "sequential least squares",
        "BSD-3-Clause",
        "scipy",
        {"ftol": absolute},
        (4, 6, 8, 10, 12, 14, 16),
        rung_settings={"maxiter": 10_000},
    )
    refuses_crossing = True
    warm_startable = True

    def build(self, p: Program, rows: Stack) -> None:
        self._rows = [
            {"type": kind, "fun": lambda x, R=R, r=r: R @ x - r, "jac": lambda x, R=R: R}
            for kind, R, r in (("eq", p.A, p.b), ("ineq", -p.G, -p.h))
            if r.size
        ]

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        lb, ub = self.program.lb, self.program.ub
        self._result = minimize(  # type: ignore[call-overload]
            partial(cost, self.program),
            inside(warm_start, lb, ub),
            jac=True,
            method="SLSQP",
            bounds=Bounds(lb, ub),
            constraints=self._rows,
            options=self.settings,
        )
        return self._result.x if self._result.success else None

    def report(self) -> Report:
        p, r, w = self.program, self._result, np.zeros(self.rows.size)
        w[p.general] = r.multipliers
        w[p.equalities] *= -1.0
        w[p.bounds] = bound_duals(cost(p, r.x)[1] + p.R.T @ w, p.lb, p.ub)
        return Report(r.x, w, r.message, int(r.nit))
