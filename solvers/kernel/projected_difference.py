"""The paper's solver: the projected difference equation.

    w(k+1) = Proj(w(k) − η (P w(k) + q)),    0 < η < 2/λ_max(P)

minimises ½ wᵀP w + qᵀw over a box: in slope coordinates the set of the paper's (7) is one, and the projection clips.
Source, proof and arithmetic stand in ``solvers/core/descent.c``. The paper runs 15 200 steps: one per sampling period
of 125 µs for 1.9 s.
"""

from collections.abc import Mapping
from functools import partial
from numbers import Real
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from qpsolvers import Problem

from solvers.core import bindings
from solvers.descent import ProjectedGradient
from solvers.protocol import Matrix, Nanoseconds, Unsupported, Vector
from solvers.timed_calls import follow_rows

MOST_STEPS = 2**53


class ProjectedDifference(ProjectedGradient):
    """Projected gradient with a fixed step, for problems with bounds only.

    A number of steps is asked for and not a tolerance, so its rungs are numbers of steps.

    Settings
    --------
    steps : int, default 15200
        Steps of one solve; the most where ``tolerance`` is set.
    step_ratio : float, default 0.5
        η λ_max/2, in (0, 1): the step as a part of the stability limit 2/λ_max; the default is η = 1/λ_max, which
        damps every direction without overshoot.
    allow_divergence : bool, default False
        Permit a step_ratio of 1 and more, which does not converge.
    diagonal_scaling : bool, default False
        Iterate in the variables w/D, D = diag(P)^−½, which keeps a box a box.
    tolerance : float or None, default None
        Stop where the projected gradient |w(k+1) − w(k)|/η falls to this part of |q| (2-norms, looked at every 16
        steps). None, the paper's, looks at nothing.

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
    always: ClassVar[Mapping[str, Any]] = MappingProxyType({"steps": 15200})
    timed_loop = bindings.time_projected

    @classmethod
    def ladder(cls, c: float) -> tuple[Mapping[str, Any], ...]:
        """Numbers of steps; the last is the paper's."""
        return tuple({"steps": steps} for steps in (1, 10, 100, 1000, 15200))

    def setup(self, problem: Problem) -> None:
        """Allocate, find the step and store P for it; raises ValueError for a setting out of range, too."""
        numbers: dict[str, Any] = {"step_ratio": 0.5, "tolerance": None, **self.settings}
        for name in ("steps", "step_ratio", "tolerance"):
            if not (isinstance(numbers[name], Real) or (name == "tolerance" and numbers[name] is None)):
                raise ValueError(f"{self.name}: {name} must be a number, and it is {numbers[name]!r}")
        if not 0 <= numbers["steps"] <= MOST_STEPS:
            raise ValueError(f"{self.name}: steps must be from 0 to {MOST_STEPS}, and it is {numbers['steps']}")
        self._steps, self._ratio = int(numbers["steps"]), float(numbers["step_ratio"])
        self._tolerance = -1.0 if numbers["tolerance"] is None else float(numbers["tolerance"])
        self._scaled = bool(numbers.get("diagonal_scaling", False))
        if not 0 < self._ratio < (np.inf if numbers.get("allow_divergence", False) else 1):
            raise ValueError(
                f"{self.name}: step_ratio must lie between 0 and 1 (the stability limit), and it is "
                f"{self._ratio}; allow_divergence=True permits more"
            )
        super().setup(problem)

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the last iterate, shape (d,); the first is the projection of ``warm_start``, or of 0."""
        self.start(warm_start)
        bindings.projected_steps(self.state, self._steps, self._tolerance)
        return self.answer()

    def time_rows(self, rows: Matrix, forgetting: float) -> tuple[Matrix, Nanoseconds]:
        """Take rows one after the other, ``steps`` steps after each from where the last ones ended; all is timed but
        the data."""
        if self._scaled or self._tolerance >= 0.0:
            raise Unsupported(f"{self.name} follows rows without diagonal scaling and tolerance only")
        loop = partial(bindings.projected_follow, self.state, self._ratio, self._steps)
        status, answers, nanoseconds = follow_rows(loop, self._P, self._q, rows, forgetting)
        self.accept(status)
        return answers, nanoseconds

    def found(self, x: Vector) -> bool:
        """Whether the steps have not diverged; how exact x is, a number of steps does not say."""
        return bool(np.isfinite(x).all())
