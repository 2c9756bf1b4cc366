"""Limited-memory quasi-Newton method with bounds (SciPy's L-BFGS-B).

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub

Source: R. H. Byrd, P. Lu, J. Nocedal, C. Zhu, "A limited memory algorithm for bound constrained optimization", SIAM
Journal on Scientific Computing 16 (1995), pages 1190 to 1208.

Timed: ``solve`` is everything, with a Python call of the cost at every step. ``gtol`` bounds the largest component of
the projected gradient and ``ftol`` the relative decrease of the cost; our settings set the latter to 0, so that the
gradient alone decides, and keep 30 corrections instead of 10, without which ill-conditioned P take ten times the steps.
With these settings the method is restarted without its corrections if rounding spoils a line search or a step does not
change the cost, since it may then be far from the optimum; after RESTARTS such restarts the answer counts as not found.
"""

import numpy as np
from scipy.optimize import Bounds, minimize

from solvers.adapter import Vector
from solvers.direct._box import BoxMinimiser, BoxResult

RESTARTS = 5
STUCK = ("RELATIVE REDUCTION", "ABNORMAL")
"""Parts of the library's messages after such an end."""


class ScipyLbfgsb(BoxMinimiser):
    """scipy.optimize.minimize(method="L-BFGS-B")."""

    warm_startable = True

    def minimise(self, start: Vector | None) -> BoxResult:
        lb, ub, options, iterations = self.program.lb, self.program.ub, self.settings, 0
        point = np.clip(np.zeros_like(lb) if start is None else start, lb, ub)
        for _ in range(1 + RESTARTS):
            result = minimize(self.cost, point, jac=True, method="L-BFGS-B", bounds=Bounds(lb, ub), options=options)
            point, iterations = result.x, iterations + int(result.get("nit", 0))  # none if all are fixed
            stuck = bool(self.settings) and any(word in result.message for word in STUCK)
            if not stuck:
                break
        return point, bool(result.success) and not stuck, str(result.message), iterations
