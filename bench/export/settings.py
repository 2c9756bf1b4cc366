"""What an export is asked for, and the numbers that follow from it.

Learning has the two ways of `piezo_model.self_learning`: *cyclic* with one step of the projected difference equation a
sample (solver ``projected_difference``), and *continuous* with the exact optimum after every sample (solver
``recursive_active_set``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from bench.export.numbers import Precision
from bench.rendering import c_identifier
from piezo_model.identification_problem import UNDETERMINED
from piezo_model.learning.continuous_learning import BELIEF, CHECKPOINT_S, PROXIMAL, TOLERANCE, TRUST
from piezo_model.learning.cyclic_learning import MIN_EXCITATION, NARROW, RECALL, SHRINKING, SMALLEST
from piezo_model.learning.settings import MIN_SLOPE, LearningSettings
from piezo_model.structure import ModelStructure
from solvers.kernels.swept_exchange import LIMIT
from solvers.kernels.swept_gram import NEGLIGIBLE, REFRESH
from solvers.kernels.swept_refresh import FLOOR, RESOLVED, SETTLED, SPENT, TOLERATED, UNSEEN
from solvers.kernels.swept_rows import GROWTH, MOST_SURPRISE

Part = Literal["compensator", "learning"]
StreamSolver = Literal["projected_difference", "recursive_active_set"]


class ExportError(ValueError):
    """An export that cannot be; the message is one sentence that says why."""


@dataclass(frozen=True)
class ExportSettings:
    """Settings of an export.

    Parameters
    ----------
    precision : "double" or "float"
        Of signals, states and the model; sums of learning are double in either.
    part : "compensator" or "learning"
        Compensation alone, or the whole self-learning loop.
    solver : "projected_difference" or "recursive_active_set"
        Of the learning.
    x_limits : pair of float, optional
        Limits of the drive in the input unit; the model's range by default.
    rate_limit : float, optional
        Largest change of the drive in input units per second; none by default.
    reset_s, build_s, learn_s, memory_s, hand_over_s, fade_s, proximal : float
        As of ``SelfLearningCompensator``.
    name : str
        Prefix of files, functions and types.

    Raises
    ------
    ExportError
        A setting is out of range.
    """

    precision: Precision = "double"
    part: Part = "compensator"
    solver: StreamSolver = "projected_difference"
    x_limits: tuple[float, float] | None = None
    rate_limit: float | None = None
    reset_s: float = LearningSettings.reset_s
    build_s: float = LearningSettings.build_s
    learn_s: float = LearningSettings.learn_s
    memory_s: float = LearningSettings.memory_s
    hand_over_s: float = LearningSettings.hand_over_s
    fade_s: float = LearningSettings.fade_s
    proximal: float = LearningSettings.proximal
    name: str = "piezo"

    def __post_init__(self) -> None:
        for field in ("reset_s", "build_s", "learn_s", "hand_over_s", "fade_s", "rate_limit", "memory_s"):
            value = getattr(self, field)
            if value is not None and not 0.0 < value < math.inf:
                raise ExportError(f"{field} must be positive, not {value}")
        if not 0.0 <= self.proximal < 1.0:
            raise ExportError(f"proximal must be at least 0 and below 1, not {self.proximal}")
        if self.x_limits is not None and any(map(math.isinf, self.x_limits)):
            raise ExportError(f"the limits of the drive must be finite, not {self.x_limits[0]:g} to {self.x_limits[1]:g}")
        if self.x_limits is not None and not self.x_limits[0] < self.x_limits[1]:
            raise ExportError(f"the lowest drive {self.x_limits[0]:g} must be below the highest {self.x_limits[1]:g}")
        try:
            c_identifier(self.name)
        except ValueError as error:
            raise ExportError(f"the name {error}") from None

    @property
    def learning(self) -> bool:
        """Whether the learning is part of it."""
        return self.part == "learning"

    @property
    def cyclic(self) -> bool:
        """Whether it learns in cycles."""
        return self.learning and self.solver == "projected_difference"

    def numbers(self, s: ModelStructure) -> dict[str, float]:
        """What the parameter file needs, in samples and unit amplitudes where the C has those."""
        def samples(seconds: float) -> int:
            return max(1, round(seconds / s.sample_time))

        low, high = (s.x_centre - s.x_scale, s.x_centre + s.x_scale) if self.x_limits is None else self.x_limits
        forgetting, interval = math.exp(-s.sample_time / self.memory_s), samples(self.hand_over_s)
        return {
            "low": low, "high": high, "fade": math.exp(-s.sample_time / self.fade_s),
            "max_step": math.inf if self.rate_limit is None else self.rate_limit * s.sample_time / s.x_scale,
            "min_slope": MIN_SLOPE, "proximal": self.proximal if self.cyclic else PROXIMAL, "belief": BELIEF, "step_ratio": 0.5,
            "undetermined": UNDETERMINED, "min_excitation": MIN_EXCITATION, "recall": RECALL, "narrow": NARROW,
            "shrinking": SHRINKING, "smallest": SMALLEST,
            "smoothing": 1.0 / samples(1.0), "trust": TRUST, "tolerance": TOLERANCE,
            "reset_samples": samples(self.reset_s), "build_samples": samples(self.build_s),
            "learn_samples": samples(self.learn_s),
            "interval": interval, "checkpoint_intervals": max(1, samples(CHECKPOINT_S) // interval),
            "half_window": samples(self.memory_s), "row_weight": 1.0 - forgetting, "root_growth": forgetting**-0.5,
            "refresh": REFRESH, "negligible": NEGLIGIBLE, "exchange_limit": LIMIT, "growth": GROWTH,
            "most_surprise": MOST_SURPRISE, "pivot": 1e-15 * s.d, "floor": FLOOR, "unseen": UNSEEN, "spent": SPENT,
            "settled": SETTLED, "resolved": RESOLVED, "tolerated": TOLERATED,
        }
