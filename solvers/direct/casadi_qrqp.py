"""qrqp: primal-dual active set method with sparse QR factors, part of CasADi, which can also write it as C.

    minimise ½ xᵀP x + qᵀx   subject to   l ≤ R x ≤ u,  lb ≤ x ≤ ub

Source: J. A. E. Andersson, J. B. Rawlings, "Sensitivity analysis for nonlinear programming in CasADi", IFAC NMPC
(2018).

Timed: as in :mod:`solvers.direct._casadi`. The library reports no time of its own. Its active set would start from
multipliers, which a warm start does not have. On bounds it is exact; with general rows it gives up often, and sometimes
calls an answer solved whose dual residual is 1e-2.
"""

from types import MappingProxyType

from solvers.backend import Backend, relative
from solvers.direct._casadi import Conic


class CasadiQrqp(Conic):
    """``casadi.conic`` with the plugin qrqp."""

    library = Backend(
        "primal-dual active set",
        "LGPL-3.0-or-later",
        "casadi",
        {"constr_viol_tol": relative, "dual_inf_tol": relative},
        (8, 12),
    )
    plugin = "qrqp"
    quiet = MappingProxyType({"print_header": False, "print_iter": False, "print_info": False})
