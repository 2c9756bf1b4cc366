"""A solver in a file of one's own, with bounds and general rows: SciPy's sequential least squares programming (SLSQP),
which builds a quasi-Newton approximation of P of its own. ``piezobench race --solver scipy_slsqp.py`` races it.

    minimise ½ xᵀP x + qᵀx   subject to   A x − b = 0,  h − G x ≥ 0,  lb ≤ x ≤ ub

Source: D. Kraft, "A software package for sequential quadratic programming", report DFVLR-FB 88-28 (1988).

Timed: ``solve`` is everything, with Python calls of cost and rows at every step. ``ftol`` is an absolute tolerance on
the cost, so the error of x is proportional to its square root. The library's Lagrangian is the cost minus multipliers
times rows; the duals of the bounds, which it does not compute, follow from stationarity.
"""

import numpy as np
from scipy.optimize import Bounds, minimize

from solvers.adapter import LibrarySolver, Program, Report, Stack, Vector
from solvers.backend import Backend, absolute


class ScipySlsqp(LibrarySolver):
    """scipy.optimize.minimize(method="SLSQP")."""

    name = "scipy_slsqp"
    library = Backend(
        "sequential least squares",
        "BSD-3-Clause",
        "scipy",
        {"ftol": absolute},
        (4, 6, 8, 10, 12, 14, 16),
        rung_settings={"maxiter": 10_000},
    )
    warm_startable = True

    def build(self, p: Program, rows: Stack) -> None:
        """Pose the rows as SciPy's constraints."""
        self._rows = [
            {"type": kind, "fun": lambda x, R=R, r=r: R @ x - r, "jac": lambda x, R=R: R}
            for kind, R, r in (("eq", p.A, p.b), ("ineq", -p.G, -p.h))
            if r.size
        ]

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        """Start from the point of the box next to ``warm_start`` or to 0."""
        lb, ub = self.program.lb, self.program.ub
        self._result = minimize(
            self._cost,
            np.clip(np.zeros_like(lb) if warm_start is None else warm_start, lb, ub),
            jac=True,
            method="SLSQP",
            bounds=Bounds(lb, ub),
            constraints=self._rows,
            options=self.settings,
        )
        return self._result.x

    def _cost(self, x: Vector) -> tuple[float, Vector]:
        """½ xᵀP x + qᵀx and its gradient P x + q, shape (d,)."""
        p = self.program
        Px = p.P @ x
        return float(0.5 * x @ Px + p.q @ x), Px + p.q

    def report(self) -> Report:
        """The duals of the bounds are what stationarity leaves, on sides with a finite bound."""
        p, r, w = self.program, self._result, np.zeros(self.rows.size)
        w[p.general] = r.multipliers
        w[p.equalities] *= -1.0
        gradient = self._cost(r.x)[1] + p.R.T @ w
        below, above = np.maximum(gradient, 0.0), np.minimum(gradient, 0.0)
        w[p.bounds] = -np.where(np.isfinite(p.lb), below, 0.0) - np.where(np.isfinite(p.ub), above, 0.0)
        return Report(bool(r.success), w, r.message, int(r.nit))
