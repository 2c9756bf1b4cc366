"""Our exact box solver in C99, cold or warm, in static memory: the sources of the lane kernel, ``solvers/core/box.h``.

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub

Timed: ``update`` scales and inverts P; ``solve`` is the exchanges.
"""

from types import MappingProxyType

from solvers.backend import Backend
from solvers.codegen._embedded import GeneratedBuiltIn
from solvers.core import bindings


class BoxActiveSet(GeneratedBuiltIn):
    """``box_active_set.c``; it has no tolerance, so its ladder has one rung."""

    library = Backend("dual active set", "MIT", "piezobench")
    warm_startable = True
    parameters = MappingProxyType({})
    core = ("box_data", "box_inverse", "box_dual", "box_proximal")
    state_bytes = bindings.box_bytes
