"""Nesterov's accelerated projected gradient with adaptive restart, for problems with bounds only.

    w(k+1) = clip(y(k) − η (P y(k) + q)),    y(k+1) = w(k+1) + β(k) (w(k+1) − w(k)),    η = 1/λ_max

in the variables w = D⁻¹ x with D = diag(P)^−½. Sources and the restart rule stand in
``solvers/core/acceleration.c``. It is the paper's recursion with two vectors more in memory, and takes the square
root of its number of steps.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

from qpsolvers import Problem

from solvers.core import bindings
from solvers.descent import ProjectedGradient
from solvers.protocol import Vector


class AcceleratedProjection(ProjectedGradient):
    """Accelerated projected gradient.

    Settings
    --------
    tolerance : float, default 1e-13
        Stop where the projected gradient falls to this part of max(|q|, |P w(0) + q|), 2-norms in the scaled variables.
    steps : int, default 100000
        The most steps of one solve.
    diagonal_scaling : bool, default True
        Scale the variables to a unit diagonal of P.

    Examples
    --------
    >>> import numpy as np, qpsolvers
    >>> s = AcceleratedProjection()
    >>> s.setup(qpsolvers.Problem(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([1.0, -4.0]), lb=np.zeros(2)))
    >>> s.solve().round(12).tolist()
    [0.0, 2.0]
    """

    name = "accelerated_projection"
    algorithm = "accelerated projected gradient"
    always: ClassVar[Mapping[str, Any]] = MappingProxyType({"tolerance": 1e-13})
    timed_loop = bindings.time_accelerated

    @classmethod
    def ladder(cls, c: float) -> tuple[Mapping[str, Any], ...]:
        """Tolerances, which are relative to the gradient at the start."""
        return tuple({"tolerance": 10.0**-k} for k in (3, 4, 5, 6, 8, 10, 12, 13))

    def setup(self, problem: Problem) -> None:
        """Allocate, scale and find the step."""
        self._tolerance, self._steps = float(self.settings["tolerance"]), int(self.settings.get("steps", 100_000))
        self._scaled = bool(self.settings.get("diagonal_scaling", True))
        super().setup(problem)

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the last iterate, shape (d,); the first is ``warm_start``, or 0, clipped."""
        self.start(warm_start)
        bindings.accelerated_steps(self.state, self._steps, self._tolerance)
        return self.answer()
