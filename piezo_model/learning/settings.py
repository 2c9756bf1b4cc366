"""Settings of a self-learning compensator."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

import solvers
from piezo_model import checks
from piezo_model.json_file import Number
from piezo_model.learning.solving import require_setting

LONGEST_S = 1e9
MOST_SAMPLES = 2**53
"""Largest number of samples for a solve."""
Mode = Literal["cyclic", "continuous"]
EXACT_SOLVERS = ("projected_difference", "box_active_set")
"""Solvers that continuous operation replaces by the core's exact solver: the default, and the exact ones."""

MIN_SLOPE = 0.1
"""Smallest slope of S⁻¹ that is learned, in normalised units. With a much smaller slope in an outer piece the drive
would hardly rise with the reference, so the output would not reach the piece and a wrong slope would persist."""


@dataclass(frozen=True)
class LearningSettings:
    """See :class:`piezo_model.self_learning.SelfLearningCompensator`; a ValueError names the invalid setting."""

    reset_s: float = 0.1
    build_s: float = 8.0
    learn_s: float = 1.9
    solver: str = "projected_difference"
    x_limits: tuple[Number, Number] | None = None
    mode: Mode = "cyclic"
    forgetting_time_s: float = 2.0
    hand_over_s: float = 0.01
    blend_time_s: float = 0.002
    rate_limit: Number | None = None
    solve_delay_samples: int = 1
    estimate_offset: bool | None = None
    adapt_range: bool | None = None
    proximal: float = 1e-6
    integral_gain: Number = 0.0
    solver_options: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).copy().items():
            if isinstance(value, np.generic):
                object.__setattr__(self, name, value.item())
        checks.one_of(get_args(Mode), mode=self.mode)
        names = ("reset_s", "build_s", "learn_s", "forgetting_time_s", "hand_over_s", "blend_time_s")
        checks.require(
            lambda t: 0.0 < t <= LONGEST_S,
            f"a positive number of seconds up to {LONGEST_S:g}",
            **{name: getattr(self, name) for name in names},
        )
        checks.share(proximal=self.proximal)
        if self.x_limits is not None:
            checks.ascending(x_limits=self.x_limits)
            object.__setattr__(self, "x_limits", tuple(map(float, self.x_limits)))
        checks.require(
            lambda steps: isinstance(steps, int) and 1 <= steps <= MOST_SAMPLES,
            f"a whole number from 1 to {MOST_SAMPLES}",
            solve_delay_samples=self.solve_delay_samples,
        )
        chosen = {"estimate_offset": self.estimate_offset, "adapt_range": self.adapt_range}
        checks.flags(0, **{name: flag is not None and flag for name, flag in chosen.items()})
        options = self.solver_options or {}
        checks.instance(Mapping, solver_options=options)
        try:
            solvers.find(self.solver, options.get("lane"))
        except KeyError as error:
            raise ValueError(error.args[0]) from None
        require_setting(options.get("setting"), self.solver, options.get("lane"))
