"""Properties of the libraries that all their lanes share: class of the algorithm, licence, ladder of settings.

A tolerance has the unit of the quantity that it bounds. The only scale known before a solve is the problem's constant
c:

    absolute, on the cost or on the cost and the residuals together      c · 10⁻ᵏ
    relative to the cost, if the library divides by it                   10⁻ᵏ
    on residuals, divided by the size of the data or not                 10⁻²⁻ᵏᐟ²
    relative, added to an absolute one                                   0

The residuals of an interior point method fall far below its gap by themselves; a tolerance on them as small as that on
the gap can be below rounding error and is then never met. Settings have the library's own names; lanes that use the
same names share the entry, and their own tables contain the differences.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

Tolerance = Callable[[float, float], float]
"""A tolerance from the constant c and the exponent k of a rung."""


def absolute(c: float, k: float) -> float:
    """c · 10⁻ᵏ."""
    return c * 10.0**-k


def relative(c: float, k: float) -> float:
    """10⁻ᵏ."""
    return 10.0**-k


def residual(c: float, k: float) -> float:
    """10⁻²⁻ᵏᐟ²."""
    return 10.0 ** (-2 - k / 2)


def nothing(c: float, k: float) -> float:
    """0."""
    return 0.0


@dataclass(frozen=True)
class Backend:
    """One library behind one or more lanes."""

    algorithm: str
    licence: str
    distribution: str
    """See :class:`solvers.protocol.Solver`."""
    tolerances: Mapping[str, Tolerance] = field(default_factory=dict)
    """The settings that differ between rungs, as functions of c and k."""
    exponents: tuple[float, ...] = ()
    """The exponent k of each rung, from loose to tight; without any the library has one rung."""
    last_rung: Mapping[str, Any] = field(default_factory=dict)
    """Further settings of the last rung, by which the library polishes its answer."""
    rung_settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of every rung."""
    fixed_settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of every rung and of the default."""

    def ladder(self, c: float) -> tuple[Mapping[str, Any], ...]:
        """The settings of each rung for a problem of the constant c > 0.

        Examples
        --------
        >>> [rung["eps_abs"] for rung in OSQP.ladder(1.0)[:2]]
        [0.0001, 1e-06]
        """
        rungs = [
            {
                **{name: tolerance(c, k) for name, tolerance in self.tolerances.items()},
                **self.rung_settings,
                **self.fixed_settings,
            }
            for k in self.exponents or (0.0,)
        ]
        rungs[-1].update(self.last_rung)
        return tuple(MappingProxyType(rung) for rung in rungs)


def between(low: float, high: float, tolerance: Tolerance) -> Tolerance:
    """A tolerance clipped to low … high, the range that the library accepts."""
    return lambda c, k: min(max(tolerance(c, k), low), high)


INTERIOR_POINT = (4, 6, 8, 10, 12, 13, 14, 15)
EPS: Mapping[str, Tolerance] = {"eps_abs": absolute, "eps_rel": nothing}
GAP: Mapping[str, Tolerance] = {"eps_duality_gap_abs": absolute, "eps_duality_gap_rel": nothing}
CONE: Mapping[str, Tolerance] = {"abstol": absolute, "reltol": nothing, "feastol": residual}
RESIDUALS: Mapping[str, Tolerance] = {"tol_feas": residual, "tol_gap_abs": absolute, "tol_gap_rel": nothing}

CLARABEL = Backend(
    "interior point", "Apache-2.0", "clarabel", RESIDUALS, INTERIOR_POINT, rung_settings={"max_iter": 1000}
)
# Commercial; their packages solve small problems without a licence file. One thread, as all solvers here.
COPT = Backend(
    "interior point",
    "proprietary",
    "coptpy",
    {"FeasTol": between(1e-9, 1e-4, residual), "DualTol": between(1e-9, 1e-4, residual), "RelGap": relative},
    INTERIOR_POINT,
    fixed_settings={"Threads": 1},
)
CVXOPT = Backend("interior point", "GPL-3.0-or-later", "cvxopt", CONE, (4, 6, 8, 10, 12, 14, 15, 16))
# At its default of 1e-6, one answer in some thousands misses a bound that is violated by less than that, a gap of 1e-6.
DAQP = Backend(
    "dual active set", "MIT", "daqp", {"primal_tol": relative}, (9, 12), rung_settings={"iter_limit": 100_000}
)
# It refuses a relative tolerance of 0. From k = 10 on it mostly ends "close to optimal".
ECOS = Backend(
    "interior point", "GPL-3.0-or-later", "ecos", {**CONE, "reltol": lambda c, k: 1e-300}, (4, 6, 7, 8, 9, 10, 12)
)
GUROBI = Backend(
    "interior point",
    "proprietary",
    "gurobipy",
    {
        "FeasibilityTol": between(1e-9, 1e-2, residual),
        "OptimalityTol": between(1e-9, 1e-2, residual),
        "BarConvTol": relative,
    },
    INTERIOR_POINT,
    fixed_settings={"Threads": 1},
)
# The regularisation changes the answer, but without it the library can hang; without a time limit it can run for ever.
HIGHS = Backend(
    "primal active set",
    "MIT",
    "highspy",
    {
        "primal_feasibility_tolerance": between(1e-10, 1e-7, relative),
        "dual_feasibility_tolerance": between(1e-10, 1e-7, relative),
        "qp_regularization_value": relative,
    },
    (7, 9, 11, 13),
    fixed_settings={"time_limit": 10.0},
)
# The interval of adaptation is counted in steps, not in seconds, so that runs are repeatable.
OSQP = Backend(
    "ADMM",
    "Apache-2.0",
    "osqp",
    EPS,
    (4, 6, 8, 10, 12, 14, 14),
    {"polishing": True},
    {"max_iter": 200_000},
    {"polishing": False, "adaptive_rho": 1, "adaptive_rho_interval": 50},
)
PIQP = Backend(
    "proximal interior point",
    "BSD-2-Clause",
    "piqp",
    {**EPS, **GAP},
    (4, 6, 8, 10, 12, 13, 14),
    rung_settings={"max_iter": 1000},
)
PROXQP = Backend(
    "proximal augmented Lagrangian",
    "BSD-2-Clause",
    "proxsuite",
    {**EPS, **GAP},
    (4, 6, 8, 10, 12, 13, 14),
    rung_settings={"max_iter": 1000, "check_duality_gap": True},
)
PYQPMAD = Backend("dual active set", "BSD-3-Clause", "pyqpmad", {"tolerance": relative}, (8, 12))
QOCO = Backend("interior point", "BSD-3-Clause", "qoco", {"abstol": absolute, "reltol": nothing}, (4, 6, 8, 10, 12, 13))
QPALM = Backend(
    "proximal augmented Lagrangian",
    "LGPL-3.0-or-later",
    "qpalm",
    EPS,
    (4, 6, 8, 10, 12, 13),
    rung_settings={"max_iter": 100_000},
)
# Its explicit method bounds slacks and multipliers from below by 1.5e-8, and thus their products; the implicit one does
# not.
QPAX = Backend(
    "interior point",
    "Apache-2.0",
    "qpax",
    {"solver_tol": absolute},
    (6, 7, 8, 10, 12),
    rung_settings={"max_iter": 100, "backend": "i"},
)
# Its residuals do not fall below its regularisation, by default 1e-8.
QTQP = Backend(
    "interior point",
    "Apache-2.0",
    "qtqp",
    {**RESIDUALS, "tol_feas": lambda c, k: 0.01 * residual(c, k)},
    (4, 6, 8, 10, 12, 14, 15, 15.5),
    rung_settings={"min_static_regularization": 1e-14},
)
QUADPROG = Backend("dual active set", "GPL-2.0-or-later", "quadprog")
# By default SCS uses MKL if its wheel contains it.
SCS = Backend(
    "ADMM, Anderson acceleration",
    "MIT",
    "scs",
    EPS,
    (4, 6, 8, 10, 12, 14),
    rung_settings={"max_iters": 1_000_000},
    fixed_settings={"linear_solver": "qdldl"},
)
XPRESS = Backend(
    "interior point",
    "proprietary",
    "xpress",
    {
        "feastol": residual,
        "optimalitytol": residual,
        "bargapstop": relative,
        "bardualstop": residual,
        "barprimalstop": residual,
    },
    INTERIOR_POINT,
    fixed_settings={"threads": 1},
)
ABSTOL_QOCO = 1e-9


def cost_unit_qoco(c: float, k: float) -> float:
    """The power of two next to c · 10⁻ᵏ / ABSTOL_QOCO, see :mod:`solvers.direct.qoco`."""
    return 2.0 ** round(math.log2(absolute(c, k) / ABSTOL_QOCO))


DIRECT: Mapping[str, Backend] = {
    "casadi_qpoases": Backend(
        "parametric active set", "LGPL-2.1-or-later", "casadi", {"terminationTolerance": relative}, (8, 12)
    ),
    "clarabel": CLARABEL,
    "cvxopt": CVXOPT,
    "daqp": DAQP,
    "highspy": HIGHS,
    "osqp": OSQP,
    "piqp": PIQP,
    "proxsuite": PROXQP,
    "pyqpmad": PYQPMAD,
    "qoco": replace(
        QOCO,
        tolerances={"abstol": lambda c, k: ABSTOL_QOCO, "reltol": nothing, "cost_unit": cost_unit_qoco},
        exponents=(4, 6, 8, 10, 12, 13, 14, 15),
    ),
    "qpalm": QPALM,
    "qtqp": QTQP,
    "quadprog": QUADPROG,
    "scipy_bvls": Backend(
        "active set", "BSD-3-Clause", "scipy", {"tol": relative}, (8, 12), rung_settings={"max_iter": 10_000}
    ),
    "scipy_lbfgsb": Backend(
        "quasi-Newton",
        "BSD-3-Clause",
        "scipy",
        {"gtol": absolute},
        (4, 5, 6, 7, 8, 9),
        rung_settings={"ftol": 0.0, "maxcor": 30, "maxls": 50, "maxiter": 100_000, "maxfun": 1_000_000},
    ),
    "scipy_nnls": Backend("active set", "BSD-3-Clause", "scipy"),
    "scs": SCS,
}
"""The libraries of the lanes direct and kernel by the names of their files."""
QPSOLVERS: Mapping[str, Backend] = {
    "clarabel": CLARABEL,
    "copt": COPT,
    "cvxopt": CVXOPT,
    "daqp": DAQP,
    "ecos": ECOS,
    "gurobi": GUROBI,
    "highs": HIGHS,
    # osqp warns unless raise_error is set.
    "osqp": replace(OSQP, fixed_settings={**OSQP.fixed_settings, "raise_error": False}),
    "piqp": PIQP,
    "proxqp": PROXQP,
    "pyqpmad": PYQPMAD,  # qpsolvers loses its duals of variables fixed by lb = ub
    "qpalm": QPALM,  # qpsolvers drops the starting point
    "qpax": QPAX,
    "qtqp": QTQP,
    "quadprog": QUADPROG,
    "scs": SCS,
}
"""The libraries of the lane qpsolvers by their names there."""
CVXPY: Mapping[str, Backend] = {
    "clarabel": CLARABEL,
    "copt": COPT,
    "cvxopt": CVXOPT,
    "daqp": DAQP,
    "ecos": ECOS,
    "gurobi": GUROBI,
    "highs": HIGHS,
    "osqp": OSQP,
    "piqp": PIQP,
    # cvxpy does not pass its tolerance on the duality gap.
    "proxqp": replace(PROXQP, tolerances=EPS, rung_settings={"max_iter": PROXQP.rung_settings["max_iter"]}),
    "qoco": QOCO,
    "qpalm": QPALM,
    "scs": SCS,
    "xpress": XPRESS,
}
"""The libraries of the lane cvxpy by their names there."""
