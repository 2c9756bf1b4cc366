"""The paper's solver: the projected difference equation.

    w(k+1) = Proj(w(k) − η (P w(k) + q)),    0 < η < 2/λ_max(P)

minimises ½ wᵀP w + qᵀw over a box: in slope coordinates the set of the paper's (7) is a box, and the projection clips.
Source, proof and arithmetic: ``solvers/core/descent.c``. The paper runs 15 200 steps: one per sampling period of 125 µs
for 1.9 s.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from solvers.built_in import Setting
from solvers.core import bindings
from solvers.kernel._descent import ProjectedGradient


class ProjectedDifference(ProjectedGradient):
    """Projected gradient with a fixed step, for problems with bounds only.

    It runs a given number of steps and has no tolerance by default, so the rungs are numbers of steps, and steps of
    other lengths up to just below the stability limit.

    Settings
    --------
    steps : int, default 15200
        Steps of one solve; their limit if ``tolerance`` is set.
    step_ratio : float, default 0.5
        η λ_max/2, in (0, 1): the step size relative to the stability limit 2/λ_max; the default is η = 1/λ_max, which
        damps every direction without overshoot. For λ_max stands an upper bound, closer than a thousandth.
    allow_divergence : bool, default False
        Permit a step_ratio of 1 or more, which does not converge.
    diagonal_scaling : bool, default False
        Iterate in the variables w/D, D = diag(P)^−½; a box stays a box.
    tolerance : float or None, default None
        Stop when the projected gradient |w − Proj(w − η (P w + q))|/η is at most this multiple of |q| (2-norms, tested
        every 16 steps), but for the rounding of its terms. None, as in the paper: all steps are taken, and the answer
        is found if it meets 1e-9.

    Examples
    --------
    >>> import numpy as np, qpsolvers
    >>> s = ProjectedDifference(steps=3)
    >>> s.setup(qpsolvers.Problem(np.diag([1.0, 2.0]), np.array([-1.0, 2.0]), lb=np.zeros(2)))
    >>> s.solve().tolist()
    [0.875, 0.0]
    """

    name = "projected_difference"
    algorithm = "projected gradient"
    fixed_settings: ClassVar[Mapping[str, Any]] = MappingProxyType({"steps": 15200})
    known = MappingProxyType(
        {
            "steps": Setting(15200, 2**53, whole=True),
            "step_ratio": Setting(0.5),
            "allow_divergence": Setting(False),
            "diagonal_scaling": Setting(False),
            "tolerance": Setting(None),
        }
    )
    take_steps = bindings.projected_steps
    timed_loop = bindings.time_projected

    @classmethod
    def ladder(cls, c: float) -> tuple[Mapping[str, Any], ...]:
        """Numbers of steps, then as many steps as the paper's of other lengths, and the paper's."""
        longer = ({"steps": 15200, "step_ratio": ratio} for ratio in (0.99, 0.9, 0.75))
        return (*({"steps": steps} for steps in (1, 10, 100, 1000)), *longer, {"steps": 15200})

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        ratio = self.options["step_ratio"]
        if not 0 < ratio < (np.inf if self.options["allow_divergence"] else 1):
            raise ValueError(
                f"{self.name}: step_ratio must lie between 0 and 1 (the stability limit), not "
                f"{ratio}; allow_divergence=True permits more"
            )
