"""Settings of an export, the numbers that follow from them, and C literals.

Learning has the two modes of `piezo_model.self_learning`: *cyclic*, with one step of the projected difference equation
per sample or a solver at the end of each building phase, and *continuous*, with the exact optimum at every interval.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

from piezo_model import ModelStructure, checks
from piezo_model.compensator import blend_factor, drive_settings
from piezo_model.learning.settings import LearningSettings, Mode, learner_numbers
from piezo_model.operator_state import drive_start
from solvers.kernel.accelerated_projection import AcceleratedProjection

Precision = Literal["double", "float"]
LARGEST, SMALLEST = 3.4028234e38, 1.1754944e-38
"""Magnitudes of the normal numbers of single precision."""
Exported = Literal["compensator", "learning"]
LoopSolver = Literal["projected_difference", "accelerated_projection", "box_active_set"]
SOLVERS: tuple[LoopSolver, ...] = get_args(LoopSolver)
EXACT_SOLVER: LoopSolver = "box_active_set"
"""The solver of the continuous mode."""
LEARNS = (
    "one projected step a sample, in cycles",
    "accelerated projected steps at the end of each building phase",
    "the exact optimum at the end of each building phase",
    "the exact optimum of each interval, continuously",
)
"""By the exportable solvers in cyclic mode, and by continuous mode."""
BLOCKS = 8
"""Blocks in the ring between step and learner; a learner that is more than BLOCKS − 2 behind loses samples."""
OTHER_NAMES = ("main", "loop", "makefile")
"""Names of files and functions of an export that have no prefix."""
LONGEST_NAME = 31
"""Significant characters of an external identifier in C99."""


class ExportError(ValueError):
    """An export that is impossible; the message is one sentence."""


@dataclass(frozen=True)
class ExportSettings:
    """Settings of an export.

    Parameters
    ----------
    precision : "double" or "float"
        Precision of signals, states and model; sums of learning are always double.
    part : "compensator" or "learning"
        The compensator alone, or the self-learning loop.
    solver : one of SOLVERS
        Solver of the learning.
    mode : "cyclic" or "continuous"
        Mode of the learning; the continuous one solves with ``box_active_set``.
    x_limits : pair of float, optional
        Limits of the drive in the input unit; the model's range by default.
    rate_limit : float, optional
        Largest change of the drive in input units per second; none by default.
    x_start : float, optional
        Where the stage is before the first drive, as of ``Compensator``.
    reset_s, build_s, learn_s, integral_gain : float
        As for ``SelfLearningCompensator``; all other numbers of learning are its defaults.
    name : str
        Prefix of files, functions and types.

    Raises
    ------
    ExportError
        A setting is out of range.
    """

    precision: Precision = "double"
    part: Exported = "compensator"
    solver: LoopSolver = "projected_difference"
    mode: Mode = "cyclic"
    x_limits: tuple[float, float] | None = None
    rate_limit: float | None = None
    x_start: float | None = None
    reset_s: float = LearningSettings.reset_s
    build_s: float = LearningSettings.build_s
    learn_s: float = LearningSettings.learn_s
    integral_gain: float = LearningSettings.integral_gain
    name: str = "piezo"

    def __post_init__(self) -> None:
        low, high = self.x_limits or (0.0, 1.0)
        for wrong, sentence in (
            (
                self.learning and self.solver not in (SOLVERS if self.cyclic else [EXACT_SOLVER]),
                f"the C does not learn with {self.solver} in {self.mode} mode; it learns with {EXACT_SOLVER} in either "
                f"mode, and with {' or '.join(SOLVERS[:-1])} in cyclic mode: --solver and --mode choose",
            ),
            (
                math.isinf(low) or math.isinf(high),
                f"the limits of the drive must be finite, not {low:g} to {high:g}",
            ),
            (not low < high, f"the lowest drive {low:g} must be below the highest {high:g}"),
            (
                not (self.name.isascii() and self.name.isidentifier() and not self.name.startswith("_")),
                f"the name {self.name!r} is not an identifier of C",
            ),
            (
                len(self.name) > LONGEST_NAME,
                f"the name has {len(self.name)} characters, and compilers may distinguish {LONGEST_NAME} at most",
            ),
            (
                self.name.lower() in OTHER_NAMES,
                f"{self.name!r} is the name of another file or function of the export; choose another --name",
            ),
        ):
            checks.check(not wrong, sentence, ExportError)

    @property
    def learning(self) -> bool:
        """Whether the export learns."""
        return self.part == "learning"

    @property
    def cyclic(self) -> bool:
        """Whether it learns in cyclic mode."""
        return self.learning and self.mode == "cyclic"

    def numbers(self, s: ModelStructure) -> dict[str, float]:
        """Numbers of the parameter file, in the units of the C code: samples and normalised units."""
        low, high = s.x_range if self.x_limits is None else self.x_limits
        with checks.refusing(ExportError):
            blend = blend_factor(s, LearningSettings.blend_time_s)
            *_, max_step, _, gain = drive_settings(s, self.rate_limit, blend, self.integral_gain).tolist()
            start = drive_start(low, high, self.x_start)
            mode: Mode = "cyclic" if self.cyclic else "continuous"
            learning = LearningSettings(self.reset_s, self.build_s, self.learn_s, self.solver, mode=mode)
            block, numbers = learner_numbers(s, learning)
        return {
            "x_start": float(start),
            "low": low,
            "high": high,
            "blend": blend,
            "integral_gain": gain,
            "max_step": max_step,
            **numbers,
            "steps": 100_000,
            "tolerance": AcceleratedProjection.fixed_settings["tolerance"],
            "block": block,
            "blocks": BLOCKS,
        }


def literal(value: float, precision: Precision = "double") -> str:
    """A C constant that reads back as the number; ExportError if single precision would overflow or lose digits.

    Examples
    --------
    >>> literal(0.1), literal(-math.inf)
    ('0.1', '-INFINITY')
    """
    value = float(value)
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    checks.check(
        precision == "double" or value == 0.0 or SMALLEST <= abs(value) <= LARGEST,
        f"the constant {value:g} does not fit into single precision; export it with --precision double",
        ExportError,
    )
    return repr(value)


def initialiser(values: Iterable[float], precision: Precision = "double") -> str:
    """The initialiser of an array; C sets missing elements at the end to zero.

    Examples
    --------
    >>> initialiser([0.0, 0.5])
    '{ 0.0, 0.5 }'
    """
    return "{ " + ", ".join(literal(value, precision) for value in values) + " }"
