"""What a self-learning compensator writes into its log, and the words that its compiled and its other half share."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import IntEnum, StrEnum
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
"""The same as numbers, for compiled code."""


class Signal(IntEnum):
    """Why compiled code came back before the end of a chunk."""

    NONE = 0
    OVER = 1
    """The time of the phase is over."""
    FAULT = 2
    """The sensor cannot be trusted."""
    CHECKPOINT = 3
    """Time to note a state to fall back on."""
    FIRST_HAND_OVER = 4
    """The first one since learning began anew."""
    FAILED = 5
    """The recursive solver gave up."""


NONE, OVER, FAULT, CHECKPOINT, FIRST_HAND_OVER, FAILED = (int(signal) for signal in Signal)


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
