"""Names of what the core's learner has in one piece (``core/learner.h``), and the numbers that its settings become."""

import math
from collections.abc import Mapping

import numpy as np

from piezo_model.learning.settings import MIN_SLOPE
from piezo_model.structure import ModelStructure

MEMORY = (
    "learning",
    "left",
    "probation",
    "level",
    "squares_in_use",
    "squares_candidate",
    "predicted",
    "established",
    "noted",
    "revert",
    "wait",
    "pending",
    "fault_count",
    "in_half",
    "x_low",
    "x_high",
    "x_low_before",
    "x_high_before",
    "hand_overs",
    "refusals",
    "faults",
    "failures",
    "span",
)
"""What a learner remembers beside vectors; the last are four numbers."""
CLOCK = ("next_interval", "phase", "phase_left", "learning_since", "error_in_use", "error_found", "past_share")
"""The first four are whole numbers."""
COUNTS = (
    "way",
    "solver",
    "middle",
    "interval",
    "checkpoint",
    "half_window",
    "reset_lasts",
    "build_lasts",
    "learn_lasts",
    "solve_lasts",
)
SHARES = ("forgetting", "share", "proximal", "min_slope", "smoothing", "step_ratio")
CONTINUOUS, CYCLIC = range(2)
EXACT, STEPS, ANSWERED = range(3)
"""Who solves: the core's exact solver, the core by projected steps, or somebody whose answer it is given."""

PROXIMAL = 1e-8
"""In continuous operation, the share of the diagonal with which the solver holds what the data leave open where it
is."""
CHECKPOINT_S = 0.5
"""Between states that are noted to be gone back to after a fault of the sensor."""
MOST_ROWS, FEWEST_ROWS = 32, 8
"""Samples of a block: many rows are added to the Gram matrix at once, and few fit into the first-level cache."""


def block_samples(counts: tuple[int, ...]) -> int:
    """Samples of a block: what divides all counts, or else as many as make the last rows of a phase few.

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


def continuous_numbers(
    s: ModelStructure, hand_over_s: float, memory_s: float, reset_s: float
) -> tuple[int, dict[str, float]]:
    """Samples of a block, and the settings of continuous operation with the exact solver."""
    block = block_samples((s.samples(hand_over_s),))
    interval = max(2, s.samples(hand_over_s) // block) * block
    forgetting = math.exp(-s.sample_time / memory_s)
    return block, {
        "way": CONTINUOUS,
        "solver": EXACT,
        "middle": s.middle,
        "interval": interval,
        "checkpoint": interval * max(1, s.samples(CHECKPOINT_S) // interval),
        "half_window": s.samples(memory_s),
        "reset_lasts": s.samples(reset_s),
        "forgetting": forgetting,
        "share": 1.0 - forgetting,
        "proximal": PROXIMAL,
        "min_slope": MIN_SLOPE,
        "smoothing": 1.0 / s.samples(1.0),
    }


def write_settings(numbers: Mapping[str, float], into: np.ndarray) -> None:
    """Write settings by their names into the core's ``LearnerSettings``; those that are not named are 0."""
    into[: len(COUNTS)].view(np.int64)[:] = [int(numbers.get(name, 0)) for name in COUNTS]
    into[len(COUNTS) :] = [numbers.get(name, 0.0) for name in SHARES]
