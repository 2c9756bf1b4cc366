"""Settings of a self-learning compensator, and the numbers in which the core (``core/learner.h``) gets them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

import solvers
from piezo_model import checks
from piezo_model.json_file import Number
from piezo_model.solving import STEPPED, require_setting, step_ratio
from piezo_model.structure import ModelStructure

INTEGER, REAL = np.int64, np.float64
SETTINGS = np.dtype(
    [
        ("mode", INTEGER),
        ("solver", INTEGER),
        ("middle", INTEGER),
        ("interval", INTEGER),
        ("checkpoint", INTEGER),
        ("half_window", INTEGER),
        ("reset_lasts", INTEGER),
        ("build_lasts", INTEGER),
        ("learn_lasts", INTEGER),
        ("solve_lasts", INTEGER),
        ("forgetting", REAL),
        ("row_weight", REAL),
        ("proximal", REAL),
        ("min_slope", REAL),
        ("smoothing", REAL),
        ("step_ratio", REAL),
    ]
)
MEMORY = np.dtype(
    [
        ("learning", REAL),
        ("reset_remaining", REAL),
        ("probation", REAL),
        ("level", REAL),
        ("squares_in_use", REAL),
        ("squares_candidate", REAL),
        ("predicted", REAL),
        ("established", REAL),
        ("has_checkpoint", REAL),
        ("revert", REAL),
        ("wait", REAL),
        ("pending", REAL),
        ("fault_count", REAL),
        ("in_half", REAL),
        ("drive", REAL, 2),
        ("drive_before", REAL, 2),
        ("hand_overs", REAL),
        ("refusals", REAL),
        ("faults", REAL),
        ("failures", REAL),
        ("reversed", REAL),
        ("span", REAL, 4),
        ("evidence", REAL, 12),
        ("stretch", REAL, 8),
        ("recent", REAL, 3),
    ]
)
CLOCK = np.dtype(
    [
        ("next_interval", INTEGER),
        ("phase", INTEGER),
        ("phase_left", INTEGER),
        ("learning_since", INTEGER),
        ("error_in_use", REAL),
        ("error_found", REAL),
        ("past_span", REAL),
    ]
)
CONTINUOUS, CYCLIC = range(2)
"""Values of ``mode``."""
EXACT, STEPS, ANSWERED = range(3)
"""Values of ``solver``: the core's exact solver, projected steps of the core, or a solver outside the core."""

PROXIMAL = 1e-8
"""Strength of the proximal term in continuous operation, as a share of each diagonal entry."""
CHECKPOINT_S = 0.5
"""Time between the checkpoints that a sensor fault goes back to."""
MOST_ROWS, FEWEST_ROWS = 32, 8
"""Largest and smallest block in samples: larger ones are added to the Gram matrix faster, smaller ones fit into the
first-level cache."""
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
    estimate_offset: bool = False
    adapt_range: bool = False
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
        checks.flags(0, estimate_offset=self.estimate_offset, adapt_range=self.adapt_range)
        options = self.solver_options or {}
        checks.instance(Mapping, solver_options=options)
        try:
            solvers.find(self.solver, options.get("lane"))
        except KeyError as error:
            raise ValueError(error.args[0]) from None
        require_setting(options.get("setting"), self.solver, options.get("lane"))


def block_samples(counts: tuple[int, ...]) -> int:
    """Samples of a block: a common divisor of all counts, or else a size that wastes few samples at the end of a phase.

    Examples
    --------
    >>> block_samples((800, 64_000, 15_200)), block_samples((80,)), block_samples((83,))
    (32, 20, 27)
    """
    common = math.gcd(*counts)
    most = min(MOST_ROWS, max(1, min(counts) // 2)) if len(counts) == 1 else MOST_ROWS
    block = max(size for size in range(1, most + 1) if common % size == 0)
    smallest = min(counts)
    return block if block >= min(FEWEST_ROWS, most) else max(1, smallest // max(2, -(-smallest // MOST_ROWS)))


def learner_numbers(s: ModelStructure, settings: LearningSettings) -> tuple[int, dict[str, float]]:
    """Samples of a block, and the :data:`SETTINGS` of a learner."""
    common = {"middle": s.middle, "reset_lasts": s.samples(settings.reset_s)}
    if settings.mode == "cyclic":
        lasts = {"build_lasts": s.samples(settings.build_s), "learn_lasts": s.samples(settings.learn_s)}
        stepped = settings.solver == STEPPED
        return block_samples((common["reset_lasts"], *lasts.values())), {
            **common,
            **lasts,
            "mode": CYCLIC,
            "solver": STEPS if stepped else ANSWERED,
            "solve_lasts": settings.solve_delay_samples,
            "forgetting": 1.0,
            "row_weight": 1.0,
            "proximal": settings.proximal,
            "min_slope": MIN_SLOPE,
            "step_ratio": step_ratio(settings.solver_options) if stepped else 0.5,
        }
    block = block_samples((s.samples(settings.hand_over_s),))
    interval = max(2, s.samples(settings.hand_over_s) // block) * block
    forgetting = math.exp(-s.sample_time / settings.forgetting_time_s)
    return block, {
        **common,
        "mode": CONTINUOUS,
        "solver": EXACT if settings.solver in EXACT_SOLVERS else ANSWERED,
        "interval": interval,
        "checkpoint": interval * max(1, s.samples(CHECKPOINT_S) // interval),
        "half_window": s.samples(settings.forgetting_time_s),
        "forgetting": forgetting,
        "row_weight": 1.0 - forgetting,
        "proximal": PROXIMAL,
        "min_slope": MIN_SLOPE,
        "smoothing": 1.0 / s.samples(1.0),
    }


def write_settings(numbers: Mapping[str, float], settings: np.ndarray) -> None:
    """Write settings by name into the core's ``LearnerSettings``, whose others are 0."""
    settings.view(SETTINGS)[0] = tuple(numbers.get(name, 0) for name in SETTINGS.names or ())
