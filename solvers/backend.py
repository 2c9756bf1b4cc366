"""What is known of a library, once for all its lanes: class, licence, and the ladder of its settings.

A tolerance is given in the unit of what it bounds, and the only unit known before a solve is the problem's constant c:

    an absolute tolerance on the cost, and one for the cost and the residuals alike          c · 10⁻ᵏ
    a share, where the library itself divides by the size of the cost                       10⁻ᵏ
    a residual, divided by the size of the data or not                                      10⁻²⁻ᵏᐟ² or c · 10⁻²⁻ᵏᐟ²
    a relative tolerance that is added to an absolute one                                   0

The residuals of an interior point method fall with its gap and far below it; asked for as tightly as the gap they are
what rounding never lets it reach. The names are those of the library itself; a lane that hands settings on under the
same names shares the entry, and says in its own table what differs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

Tolerance = Callable[[float, float], float]
"""A tolerance from the constant c and the exponent k of a rung."""


def absolute(c: float, k: float) -> float:
    """c · 10⁻ᵏ."""
    return c * 10.0**-k


def share(c: float, k: float) -> float:
    """10⁻ᵏ."""
    return 10.0**-k


def residual(c: float, k: float) -> float:
    """10⁻²⁻ᵏᐟ²."""
    return 10.0 ** (-2 - k / 2)


def unscaled(c: float, k: float) -> float:
    """c · 10⁻²⁻ᵏᐟ²."""
    return c * residual(c, k)


def nothing(c: float, k: float) -> float:
    """0."""
    return 0.0


@dataclass(frozen=True)
class Backend:
    """One library behind one or more lanes."""

    algorithm: str
    licence: str
    distribution: str
    """As of :class:`solvers.protocol.Solver`."""
    tolerances: Mapping[str, Tolerance] = field(default_factory=dict)
    """The settings that change from rung to rung, each a function of c and k."""
    rungs: tuple[float, ...] = ()
    """The exponents k, from loose to tight; without any the library has one rung."""
    polished: tuple[float, ...] = ()
    """The exponents of the rungs that follow with ``polish``."""
    polish: Mapping[str, Any] = field(default_factory=dict)
    """Settings by which the library improves the answer that it ended with."""
    more: Mapping[str, Any] = field(default_factory=dict)
    """Settings of every rung."""
    always: Mapping[str, Any] = field(default_factory=dict)
    """Settings of every rung and of the default, too."""

    @property
    def exponents(self) -> tuple[float, ...]:
        """The exponent of each rung."""
        return self.rungs + self.polished

    @property
    def has_settings(self) -> bool:
        """Whether there is anything to set."""
        return bool(self.tolerances or self.more or self.always)

    def ladder(self, c: float) -> tuple[Mapping[str, Any], ...]:
        """The settings of each rung for a problem of the constant c > 0.

        Examples
        --------
        >>> [rung["eps_abs"] for rung in OSQP.ladder(1.0)[:2]]
        [0.0001, 1e-06]
        """
        steps: list[tuple[float, Mapping[str, Any]]] = [(k, {}) for k in self.rungs] + [
            (k, self.polish) for k in self.polished
        ]
        return tuple(
            MappingProxyType(
                {
                    **{name: tolerance(c, k) for name, tolerance in self.tolerances.items()},
                    **self.more,
                    **self.always,
                    **polish,
                }
            )
            for k, polish in steps or [(0, {})]
        )


def between(low: float, high: float, tolerance: Tolerance) -> Tolerance:
    """A tolerance of a library that refuses what lies outside low … high."""
    return lambda c, k: min(max(tolerance(c, k), low), high)


INTERIOR_POINT = (4, 6, 8, 10, 12, 13, 14, 15)
EPS: Mapping[str, Tolerance] = {"eps_abs": absolute, "eps_rel": nothing}
GAP: Mapping[str, Tolerance] = {"eps_duality_gap_abs": absolute, "eps_duality_gap_rel": nothing}
CONE: Mapping[str, Tolerance] = {"abstol": absolute, "reltol": nothing, "feastol": residual}
RESIDUALS: Mapping[str, Tolerance] = {"tol_feas": residual, "tol_gap_abs": absolute, "tol_gap_rel": nothing}

CLARABEL = Backend("interior point", "Apache-2.0", "clarabel", RESIDUALS, INTERIOR_POINT, more={"max_iter": 1000})
# Commercial; their packages solve small problems without a licence file. One thread, as all solvers here.
COPT = Backend(
    "interior point",
    "proprietary",
    "coptpy",
    {"FeasTol": between(1e-9, 1e-4, residual), "DualTol": between(1e-9, 1e-4, residual), "RelGap": share},
    INTERIOR_POINT,
    always={"Threads": 1},
)
CVXOPT = Backend("interior point", "GPL-3.0-or-later", "cvxopt", CONE, (4, 6, 8, 10, 12, 14, 15, 16))
# At its own 1e-6 one answer in some thousands leaves out a bound that is violated by less, a gap of 1e-6 that no
# calibration sees.
DAQP = Backend("dual active set", "MIT", "daqp", {"primal_tol": share}, (9, 12), more={"iter_limit": 100_000})
# It refuses a relative tolerance of 0. From k = 10 on it ends "close to optimal" more often than not.
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
        "BarConvTol": share,
    },
    INTERIOR_POINT,
    always={"Threads": 1},
)
# The regularisation moves the answer, and without any the library can hang; without a limit it can run for ever.
HIGHS = Backend(
    "primal active set",
    "MIT",
    "highspy",
    {
        "primal_feasibility_tolerance": between(1e-10, 1e-7, share),
        "dual_feasibility_tolerance": between(1e-10, 1e-7, share),
        "qp_regularization_value": share,
    },
    (7, 9, 11, 13),
    always={"time_limit": 10.0},
)
# Its least multiplier, 1e-16, times the number in place of an infinite bound is more complementarity than the rungs
# from 10⁻¹⁰ allow.
HPIPM = Backend(
    "interior point",
    "BSD-2-Clause",
    "casadi",
    {"res_m_max": absolute, "res_g_max": unscaled, "res_b_max": residual, "res_d_max": residual},
    INTERIOR_POINT,
    more={"iter_max": 200, "lam_min": 1e-30, "t_min": 1e-30},
)
# Counted in steps and not in seconds, so that a run can be repeated.
OSQP = Backend(
    "ADMM",
    "Apache-2.0",
    "osqp",
    EPS,
    (4, 6, 8, 10, 12, 14),
    (14,),
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
    more={"max_iter": 1000},
)
PROXQP = Backend(
    "proximal augmented Lagrangian",
    "BSD-2-Clause",
    "proxsuite",
    {**EPS, **GAP},
    (4, 6, 8, 10, 12, 13, 14),
    more={"max_iter": 1000, "check_duality_gap": True},
)
PYQPMAD = Backend("dual active set", "BSD-3-Clause", "pyqpmad", {"tolerance": share}, (8, 12))
QOCO = Backend("interior point", "BSD-3-Clause", "qoco", {"abstol": absolute, "reltol": nothing}, (4, 6, 8, 10, 12, 13))
QPALM = Backend(
    "proximal augmented Lagrangian",
    "LGPL-3.0-or-later",
    "qpalm",
    EPS,
    (4, 6, 8, 10, 12, 13),
    more={"max_iter": 100_000},
)
# Its explicit method keeps slacks and multipliers above 1.5e-8 and so their products, the implicit one does not.
QPAX = Backend(
    "interior point",
    "Apache-2.0",
    "qpax",
    {"solver_tol": absolute},
    (6, 7, 8, 10, 12),
    more={"max_iter": 100, "backend": "i"},
)
# The regularisation of 1e-8 is what its residuals end at; with less of it they can be asked for.
QTQP = Backend(
    "interior point",
    "Apache-2.0",
    "qtqp",
    {**RESIDUALS, "tol_feas": lambda c, k: 0.01 * residual(c, k)},
    (4, 6, 8, 10, 12, 14, 15, 15.5),
    more={"min_static_regularization": 1e-14},
)
QUADPROG = Backend("dual active set", "GPL-2.0-or-later", "quadprog")
# Left alone, SCS takes MKL where the wheel brings it.
SCS = Backend(
    "ADMM, Anderson acceleration",
    "MIT",
    "scs",
    EPS,
    (4, 6, 8, 10, 12, 14),
    more={"max_iters": 1_000_000},
    always={"linear_solver": "qdldl"},
)
XPRESS = Backend(
    "interior point",
    "proprietary",
    "xpress",
    {
        "feastol": residual,
        "optimalitytol": residual,
        "bargapstop": share,
        "bardualstop": residual,
        "barprimalstop": residual,
    },
    INTERIOR_POINT,
    always={"threads": 1},
)
