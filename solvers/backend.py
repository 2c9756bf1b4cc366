"""What is known of the libraries that the lanes qpsolvers and cvxpy reach: class, licence and settings of each tier.

A tier's tolerance ε goes to the settings named here, absolute and relative alike. The names are those of the library
itself; a lane that hands settings on under the same names shares the entry, and says in its own table what differs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from solvers.protocol import Tier


@dataclass(frozen=True)
class Backend:
    """One library behind a lane."""

    algorithm: str
    licence: str
    distribution: str
    tolerances: tuple[str, ...] = ()
    """Settings that take ε."""
    more: Mapping[str, Any] = field(default_factory=dict)
    """Settings of every tier but the default one."""
    each: Mapping[Tier, Mapping[str, Any]] = field(default_factory=dict)
    """Settings of one tier."""
    always: Mapping[str, Any] = field(default_factory=dict)
    """Settings of every tier, the default one too."""
    warm: bool = False
    """Whether the lane hands a starting point on to a library that uses it."""

    def tiers(self) -> Mapping[Tier, Mapping[str, Any]]:
        """The settings of each tier."""
        asked = {tier: {} if tier is Tier.DEFAULT else dict.fromkeys(self.tolerances, tier.tolerance) | {**self.more}
                 for tier in Tier}
        return MappingProxyType({tier: {**asked[tier], **self.each.get(tier, {}), **self.always} for tier in Tier})


EPS = ("eps_abs", "eps_rel")
GAP = ("eps_duality_gap_abs", "eps_duality_gap_rel")
CONE = ("abstol", "reltol", "feastol")
RESIDUALS = ("tol_feas", "tol_gap_abs", "tol_gap_rel")

CLARABEL = Backend("interior point", "Apache-2.0", "clarabel", RESIDUALS, {"max_iter": 1000})
# Commercial; their packages solve small problems without a licence file. One thread, as all solvers here.
COPT = Backend("interior point", "proprietary", "coptpy", ("FeasTol", "DualTol", "RelGap"), always={"Threads": 1})
CVXOPT = Backend("interior point", "GPL-3.0-or-later", "cvxopt", CONE)
DAQP = Backend("dual active set", "MIT", "daqp", ("primal_tol",), {"iter_limit": 100_000})
ECOS = Backend("interior point", "GPL-3.0-or-later", "ecos", CONE)
GUROBI = Backend("interior point", "proprietary", "gurobipy", ("FeasibilityTol", "OptimalityTol", "BarConvTol"),
                 always={"Threads": 1})
# The regularisation moves the answer, and without any the library can hang; without a limit it can run for ever.
HIGHS = Backend("primal active set", "MIT", "highspy",
                ("primal_feasibility_tolerance", "dual_feasibility_tolerance"),
                each={tier: {"qp_regularization_value": value}
                      for tier, value in {Tier.LOW: 1e-7, Tier.MID: 1e-10, Tier.HIGH: 1e-12}.items()},
                always={"time_limit": 10.0})
OSQP = Backend("ADMM", "Apache-2.0", "osqp", EPS, {"max_iter": 200_000})
PIQP = Backend("proximal interior point", "BSD-2-Clause", "piqp", EPS + GAP, {"max_iter": 1000})
PROXQP = Backend("proximal augmented Lagrangian", "BSD-2-Clause", "proxsuite", EPS, {"max_iter": 100_000})
PYQPMAD = Backend("dual active set", "BSD-3-Clause", "pyqpmad", ("tolerance",))
QOCO = Backend("interior point", "BSD-3-Clause", "qoco", ("abstol", "reltol"))
QPALM = Backend("proximal augmented Lagrangian", "LGPL-3.0-or-later", "qpalm", EPS, {"max_iter": 100_000})
QPAX = Backend("interior point", "Apache-2.0", "qpax", ("solver_tol",), {"max_iter": 50})
QTQP = Backend("interior point", "Apache-2.0", "qtqp", RESIDUALS)
QUADPROG = Backend("dual active set", "GPL-2.0-or-later", "quadprog")
# Left alone, SCS takes MKL where the wheel brings it.
SCS = Backend("ADMM, Anderson acceleration", "MIT", "scs", EPS, {"max_iters": 1_000_000},
              always={"linear_solver": "qdldl"})
XPRESS = Backend("interior point", "proprietary", "xpress", ("feastol", "optimalitytol", "bargapstop", "bardualstop", "barprimalstop"),
                 always={"threads": 1})
