"""Trust region interior point method (SciPy's trust-constr) with the exact second derivative P.

    minimise ½ xᵀP x + qᵀx   subject to   l ≤ R x ≤ u,  lb ≤ x ≤ ub

Source: R. H. Byrd, M. E. Hribar, J. Nocedal, "An interior point algorithm for large-scale nonlinear programming", SIAM
Journal on Optimization 9 (1999), pages 877 to 900.

Timed: ``solve`` is everything; expect tens of milliseconds. ``barrier_tol`` bounds the last barrier parameter and
``xtol`` the last trust radius. A rung sets ``gtol`` far below them, since the library's test of the gradient ignores
complementarity and on its own stops with errors of x of 1e-2. With such a small ``gtol`` the library also reports a
constraint violation of 1e-15 as a failure, so found or not follows from its status and ``xtol``. There is no warm
start: from a point on the bounds an interior method takes longer.
"""

from functools import partial

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, minimize

from solvers.adapter import LibrarySolver, Program, Report, Stack, Vector
from solvers.backend import Backend, absolute, relative
from solvers.direct._box import cost, inside

CONVERGED = (1, 2, 4)
"""The library's statuses for the gradient's test, the trust radius's, and either of them with rows violated by gtol."""


class ScipyTrustConstr(LibrarySolver):
    """scipy.optimize.minimize(method="trust-constr")."""

    library = Backend(
        "interior point",
        "BSD-3-Clause",
        "scipy",
        {"gtol": lambda c, k: 1e-6 * absolute(c, k), "xtol": relative, "barrier_tol": absolute},
        (4, 6, 8, 10, 12),
        rung_settings={"maxiter": 10_000},
    )
    refuses_crossing = True

    def build(self, p: Program, rows: Stack) -> None:
        R = p.R[p.general]
        self._rows = [LinearConstraint(R, p.l[p.general], p.u[p.general])] if len(R) else []

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        p = self.program
        self._result = r = minimize(  # type: ignore[call-overload]
            partial(cost, p),
            inside(None, p.lb, p.ub),
            jac=True,
            hess=lambda x: p.P,
            method="trust-constr",
            bounds=Bounds(p.lb, p.ub),
            constraints=self._rows,
            options=self.settings,
        )
        return r.x if r.status in CONVERGED and r.constr_violation <= self.settings.get("xtol", 1e-8) else None

    def report(self) -> Report:
        r = self._result
        w = np.concatenate([r.v[-1], *r.v[:-1]])
        return Report(r.x, w, f"{r.status}: {r.message}", int(r.nit), 1e6 * r.execution_time)
