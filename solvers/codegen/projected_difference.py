"""The paper's projected difference equation in C99.

    w(k+1) = Proj(w(k) − η (P w(k) + q)),    η = step_ratio · 2/λ_max(P)

The sources of the lane kernel, ``solvers/core/descent.h``, in static memory. Timed: ``update`` computes λ_max,
``solve`` runs ``steps`` steps from 0 or from ``warm_start``.
"""

from types import MappingProxyType

from solvers.adapter import Program, Stack
from solvers.backend import Backend
from solvers.codegen._embedded import GeneratedBuiltIn
from solvers.core import bindings
from solvers.kernel import projected_difference as kernel


class ProjectedDifference(GeneratedBuiltIn):
    """``projected_difference.c``; the settings are those of the lane kernel."""

    library = Backend(
        "projected gradient", "MIT", "piezobench", fixed_settings=kernel.ProjectedDifference.fixed_settings
    )
    warm_startable = True
    iteration_setting = "steps"
    parameters = MappingProxyType({"steps": 15200.0, "step_ratio": 0.5})
    ladder = kernel.ProjectedDifference.ladder
    core = ("descent", "eigenvalue")
    state_bytes = bindings.descent_bytes

    def build(self, p: Program, rows: Stack) -> None:
        kernel.ProjectedDifference(**self.settings)  # refuses settings out of range
        super().build(p, rows)
