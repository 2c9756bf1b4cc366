"""Limited-memory quasi-Newton method with bounds (SciPy's L-BFGS-B).

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub

Source: R. H. Byrd, P. Lu, J. Nocedal, C. Zhu, "A limited memory algorithm for bound constrained optimization", SIAM
Journal on Scientific Computing 16 (1995), pages 1190 to 1208.

Timed: ``solve`` is everything, the cost being called from Python at every step. ``gtol`` bounds the largest component
of the projected gradient and ``ftol`` the relative decrease of the cost; with our settings the second is 0, so that the
gradient alone decides, and 30 corrections are kept in place of 10, without which ill-conditioned P take ten times the
steps. Where rounding spoils the line search before that, the
library ends as ABNORMAL, and the answer counts as not found.
"""

from __future__ import annotations

from functools import partial

from scipy.optimize import Bounds, minimize

from solvers.backend import Backend, absolute
from solvers.direct._box import BoxMinimiser, Outcome, cost, inside
from solvers.protocol import Vector


class ScipyLbfgsb(BoxMinimiser):
    """scipy.optimize.minimize(method="L-BFGS-B")."""

    name = "scipy_lbfgsb"
    library = Backend("quasi-Newton", "BSD-3-Clause", "scipy", {"gtol": absolute}, (4, 5, 6, 7, 8, 9),
                      more={"ftol": 0.0, "maxcor": 30, "maxls": 50, "maxiter": 100_000, "maxfun": 1_000_000})
    warm_startable = True

    def minimise(self, start: Vector | None) -> Outcome:  # noqa: D102
        result = minimize(  # type: ignore[call-overload]
            partial(cost, self.program), inside(start, self.lb, self.ub), jac=True, method="L-BFGS-B",
            bounds=Bounds(self.lb, self.ub), options=self.settings)
        return Outcome(result.x, bool(result.success), str(result.message), int(result.nit))
