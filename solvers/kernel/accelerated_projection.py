"""Nesterov's accelerated projected gradient with adaptive restart, for problems with bounds only.

    w(k+1) = clip(y(k) − η (P y(k) + q)),    y(k+1) = w(k+1) + β(k) (w(k+1) − w(k)),    η = 1/λ_max

in the variables w = D⁻¹ x with D = diag(P)^−½. Sources and the restart rule: ``solvers/core/acceleration.c``. It is the
paper's recursion with two more vectors in memory, and takes about the square root of its number of steps.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

from solvers.built_in import Setting
from solvers.core import bindings
from solvers.kernel._descent import ProjectedGradient


class AcceleratedProjection(ProjectedGradient):
    """Accelerated projected gradient.

    Settings
    --------
    tolerance : float, default 1e-13
        Stop when the projected gradient is at most this multiple of max(|q|, |P w(0) + q|), 2-norms in the scaled
        variables. The answer is found if its own is, but for the rounding of its terms.
    steps : int, default 100000
        Limit of the steps of one solve.
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
    fixed_settings: ClassVar[Mapping[str, Any]] = MappingProxyType({"tolerance": 1e-13})
    known = MappingProxyType(
        {
            "tolerance": Setting(1e-13),
            "steps": Setting(100_000, 2**53, whole=True),
            "diagonal_scaling": Setting(True),
        }
    )
    take_steps = bindings.accelerated_steps
    timed_loop = bindings.time_accelerated

    @classmethod
    def ladder(cls, c: float) -> tuple[Mapping[str, Any], ...]:
        """Tolerances, which are relative to the gradient at the start."""
        return tuple({"tolerance": 10.0**-k} for k in (3, 4, 5, 6, 8, 10, 12, 13))
