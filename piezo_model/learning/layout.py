"""Layout of the core's learner (``core/learner.h``), and the settings that it gets."""

import math
from collections.abc import Mapping

import numpy as np

from piezo_model.learning.settings import EXACT_SOLVERS, MIN_SLOPE, LearningSettings
from piezo_model.learning.solving import STEPPED, step_ratio
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
