"""Log entries of a self-learning compensator, and the enumerations that Python shares with the core."""

import math
from dataclasses import dataclass
from enum import IntEnum, IntFlag, StrEnum
from typing import Literal


class Phase(StrEnum):
    """Phases in the core's order; continuous operation has ``reset`` and ``learn`` only."""

    RESET = "reset"
    BUILD = "build"
    LEARN = "learn"


class BlockEvent(IntFlag):
    """Events of a block, as in ``core/learner.h``."""

    TAKE_OVER = 1
    SENSOR_FAULT = 2
    PROGRAM = 4
    UNEXCITED = 8
    NOT_A_NUMBER = 16
    WORSE = 32
    CYCLE_OVER = 64
    FIRST = 128
    CHECK_RANGE = 256
    OTHER_SENSOR = 512
    NO_OPTIMUM = 1024
    REVERSED = 2048


class Verdict(IntEnum):
    """Verdicts of the sensor guard (``core/sensor_guard.h``) on a sample."""

    GOOD = 0
    MISSING = 1
    REFUSED = 2
    JUMPED = 3


@dataclass(frozen=True)
class Event:
    """A hand-over, a refusal, a sensor fault or a change of ranges; times in samples."""

    sample: int
    what: Literal["hand-over", "refused", "sensor", "range"]
    message: str
    error_old: float = math.nan
    """RMS error (5) of the old weights on the learned data, in normalised units."""
    error_new: float = math.nan
    learning_since: int = 0
    """Sample at which the solver began."""
