"""Log entries of a self-learning compensator, and the enumerations that Python shares with the core."""

import math
from dataclasses import dataclass
from enum import IntEnum, IntFlag, StrEnum
from typing import Literal

Phase = StrEnum("Phase", "RESET BUILD LEARN")
"""Phases in the core's order; continuous operation has ``reset`` and ``learn`` only."""
BlockEvent = IntFlag(
    "BlockEvent",
    "TAKE_OVER SENSOR_FAULT PROGRAM UNEXCITED NOT_A_NUMBER WORSE CYCLE_OVER FIRST CHECK_RANGE OTHER_SENSOR NO_OPTIMUM "
    "REVERSED",
)
"""Events of a block, as in ``core/learner.h``."""
Verdict = IntEnum("Verdict", "GOOD MISSING REFUSED JUMPED", start=0)
"""Verdicts of the sensor guard (``core/sensor_guard.h``) on a sample."""
REVERSED = (
    "the output falls as the input rises, so the weights in use stay; reverse the sensor, or give y_range in "
    "descending order"
)
MESSAGES = {
    BlockEvent.SENSOR_FAULT: ("sensor", "the output jumped, froze or left its range; learning waits"),
    BlockEvent.FIRST: ("hand-over", "the first new weights since learning began; further ones are counted only"),
    BlockEvent.OTHER_SENSOR: ("sensor", "the output is not what it was before the fault; learning begins anew"),
    BlockEvent.NO_OPTIMUM: ("refused", "the data have no optimum; learning begins anew"),
    BlockEvent.REVERSED: ("refused", REVERSED),
    BlockEvent.UNEXCITED: (
        "refused",
        "the drive went through {percent:.1f} % of its range only, and 2 % are needed",
    ),
    BlockEvent.NOT_A_NUMBER: ("refused", "the solver {solver} found no finite weights"),
    BlockEvent.WORSE: ("refused", "the new weights explain the data worse than the old ones"),
    BlockEvent.CYCLE_OVER: ("hand-over", "new weights"),
}
"""Log entries of events. Further hand-overs and refusals of continuous operation, and further refusals of a reversed
output, are only counted."""


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
