"""The paper's projected difference equation in C99.

    w(k+1) = Proj(w(k) − η (P w(k) + q)),    η = step_ratio · 2/λ_max(P)

The recursion of :mod:`solvers.kernels.projected_step` for bounds, written as a firmware would have it. λ_max comes from the
power method, which is part of ``update`` and stops at 1e-6 of its value, from below; so η is larger than asked for by about
that. Timed in ``solve``: ``steps`` steps from 0, or from ``warm_start``.
"""

from __future__ import annotations

from types import MappingProxyType

from solvers.codegen._embedded import OurOwn


class ProjectedDifference(OurOwn):
    """``projected_difference.c``; the settings are those of the lane kernel."""

    name = "projected_difference"
    algorithm = "projected gradient"
    warm_startable = True
    iteration_setting = "steps"
    parameters = MappingProxyType({"steps": 15200.0, "step_ratio": 0.5})
    variants = tuple({"steps": steps} for steps in (1, 10, 100, 1000, 15200))
