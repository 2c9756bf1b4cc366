"""What a self-learning compensator writes into its log, and the words that the core and Python share."""

import math
from collections import deque
from dataclasses import dataclass
from enum import IntEnum, IntFlag, StrEnum
from typing import Literal

LOG_LENGTH = 1000
"""Events kept; older ones go."""


class Phase(StrEnum):
    """States of the machine; continuous operation has ``reset`` and ``learn`` only."""

    RESET = "reset"
    BUILD = "build"
    LEARN = "learn"


PHASES = tuple(Phase)
RESET, BUILD, LEARN = range(3)
"""The same as the core has them."""


class BlockEvent(IntFlag):
    """What came of a block, as of ``core/learner.h``."""

    TAKE_OVER = 1
    SENSOR_FAULT = 2
    PROGRAM = 4
    UNEXCITED = 8
    NOT_A_NUMBER = 16
    WORSE = 32
    CYCLE_OVER = 64
    FIRST = 128
    LOOK = 256
    OTHER_SENSOR = 512
    NO_OPTIMUM = 1024


class Verdict(IntEnum):
    """What the guard of the sensor (``core/sensor_guard.h``) says of one sample."""

    GOOD = 0
    MISSING = 1
    REFUSED = 2
    JUMPED = 3


@dataclass(frozen=True)
class Event:
    """Something worth knowing: a hand-over, a refusal, a fault of the sensor; times in samples."""

    sample: int
    what: Literal["hand-over", "refused", "sensor", "range"]
    message: str
    error_old: float = math.nan
    """RMS error (5) of the weights in use on the data that were learned from, unit amplitudes."""
    error_new: float = math.nan
    learning_since: int = 0
    """When the solver began."""


Log = deque[Event]
