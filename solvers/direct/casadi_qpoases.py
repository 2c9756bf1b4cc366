"""qpOASES: parametric active set method, reached through CasADi.

    minimise ½ xᵀP x + qᵀx   subject to   l ≤ R x ≤ u,  lb ≤ x ≤ ub

Source: H. J. Ferreau, C. Kirches, A. Potschka, H. G. Bock, M. Diehl, "qpOASES: a parametric active-set algorithm for
quadratic programming", Mathematical Programming Computation 6 (2014), pages 327 to 363.

Timed: as in :mod:`solvers.direct._casadi`.
"""

from types import MappingProxyType

from solvers.backend import Backend, relative
from solvers.direct._casadi import Conic


class CasadiQpoases(Conic):
    """``casadi.conic`` with the plugin qpoases."""

    library = Backend(
        "parametric active set", "LGPL-2.1-or-later", "casadi", {"terminationTolerance": relative}, (8, 12)
    )
    plugin = "qpoases"
    quiet = MappingProxyType({"printLevel": "none"})
