"""Our exact box solver in C99, cold or warm, in static memory and without recursion: block principal pivoting.

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub

A guess of which variables are free leaves one linear system; variables outside their bounds become fixed and bounds whose
gradient points inwards become free, all at once, and the last of them alone where that does not help. Sources: J. J. Júdice,
F. M. Pires, "A block principal pivoting algorithm for large-scale strictly monotone linear complementarity problems",
Computers & Operations Research 21 (1994), pages 587 to 596; K. G. Murty, "Note on a Bard-type scheme for solving the
complementarity problem", Opsearch 11 (1974), pages 123 to 130.

The method of :mod:`solvers.kernels.box_pivoting` without its special arrangement of the factor: plain loops that a compiler
can vectorise. Timed: ``update`` scales P to unit diagonal; ``solve`` is the pivoting, each system factorised anew.
"""

from __future__ import annotations

from types import MappingProxyType

from solvers.codegen._embedded import OurOwn


class BoxActiveSet(OurOwn):
    """``box_active_set.c``; it has no tolerance, so every tier is the same."""

    name = "box_active_set"
    algorithm = "primal-dual active set"
    warm_startable = True
    parameters = MappingProxyType({})
