"""Settings of a self-learning compensator."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import solvers
from piezo_model.json_file import Number
from piezo_model.learning.solving import require_setting

LONGEST_S = 1e9
MOST_SAMPLES = 2**53
"""Largest number of samples for a solve."""
Mode = Literal["cyclic", "continuous"]
EXACT_SOLVERS = ("projected_difference", "box_active_set", "recursive_active_set")
"""Solvers that continuous operation replaces by the core's exact solver: the default, and the exact ones."""

MIN_SLOPE = 0.1
"""Smallest slope of S⁻¹ that is learned, in unit amplitudes. With a much smaller slope in an outer piece the drive
would hardly rise with the reference, so the output would not reach the piece and a wrong slope would persist."""


def require_seconds(**times: float) -> None:
    """Require times above 0 and up to :data:`LONGEST_S`; the ValueError names the setting."""
    for name, value in times.items():
        if not (isinstance(value, int | float) and 0.0 < value <= LONGEST_S):
            raise ValueError(f"{name} must be a positive number of seconds up to {LONGEST_S:g}, not {value!r}")


@dataclass(frozen=True)
class LearningSettings:
    """See :class:`piezo_model.self_learning.SelfLearningCompensator`; a ValueError names the invalid setting."""

    reset_s: float = 0.1
    build_s: float = 8.0
    learn_s: float = 1.9
    solver: str = "projected_difference"
    x_limits: tuple[Number, Number] | None = None
    mode: Mode = "cyclic"
    memory_s: float = 2.0
    hand_over_s: float = 0.01
    fade_s: float = 0.002
    rate_limit: Number | None = None
    samples_to_solve: int = 1
    find_centre: bool | None = None
    follow_range: bool | None = None
    proximal: float = 1e-6
    integral_gain: Number = 0.0
    solver_options: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        if self.mode not in get_args(Mode):
            raise ValueError(f"mode must be one of {', '.join(get_args(Mode))}, not {self.mode!r}")
        require_seconds(reset_s=self.reset_s, build_s=self.build_s, learn_s=self.learn_s)
        require_seconds(memory_s=self.memory_s, hand_over_s=self.hand_over_s, fade_s=self.fade_s)
        if not (isinstance(self.proximal, int | float) and 0.0 <= self.proximal < 1.0):
            raise ValueError(f"proximal must be at least 0 and below 1, not {self.proximal!r}")
        steps = self.samples_to_solve
        if not (isinstance(steps, int) and 1 <= steps <= MOST_SAMPLES):
            raise ValueError(f"samples_to_solve must be a whole number from 1 to {MOST_SAMPLES}, not {steps!r}")
        options = self.solver_options or {}
        try:
            solvers.find(self.solver, options.get("lane"))
        except KeyError as error:
            raise ValueError(error.args[0]) from None
        require_setting(options.get("setting"), self.solver, options.get("lane"))
