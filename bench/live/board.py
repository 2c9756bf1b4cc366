"""Memory that the processes of a live run share, without locks.

The loop writes samples into a ring and counts them; readers copy the newest ones and never delay the loop. The set
point and the request to stop go the other way. Every number has one writer at a time.
"""

import math
from ctypes import Structure, c_double, c_int64, c_wchar
from enum import IntEnum
from multiprocessing.sharedctypes import RawValue

import numpy as np

from solvers.arrays import Matrix

CAPACITY = 1 << 19
"""Samples in the ring: a disk that stalls for 45 s loses none at 10 kHz."""
EVENTS, LONGEST = 64, 480
"""Number and length of the last events."""
EDGES_US = [0.1 * 10.0 ** (k / 20.0) for k in range(221)]
"""Between these service times, samples are counted together."""
FOLLOW = math.inf
"""Set point that selects the reference."""


class State(IntEnum):
    """State of the stage, which its loop or, at last, another process drives."""

    STARTING = 0
    FOLLOWING = 1
    RAMPING_TO_REST = 2
    AT_REST = 3
    BROUGHT_TO_REST = 4


class Board(Structure):
    """The shared memory, from :func:`new_board`; a process started with it shares it."""

    _fields_ = (
        ("set_point", c_double),
        ("stop", c_int64),  # 1 to stop
        ("state", c_int64),
        ("drive", c_double),  # the last one that the stage may have taken
        ("head", c_int64),  # samples written
        ("followed", c_int64),  # samples before the ramp to rest
        ("missed", c_int64),  # deadlines, those of skipped due times too
        ("null_missed", c_int64),  # by a loop that does nothing, in a second
        ("hand_overs", c_int64),
        ("reason", c_wchar * LONGEST),  # why the run ends, or the stage could not be opened
        ("events", c_int64),
        ("texts", c_wchar * LONGEST * EVENTS),
        ("service", c_int64 * (len(EDGES_US) + 1)),
        ("ring", c_double * 4 * CAPACITY),
    )

    def write(self, sample: tuple[float, float, float, float]) -> None:
        """Write the next sample and count it: time in s, reference, drive and measured output."""
        self.ring[self.head % CAPACITY] = sample
        self.head += 1

    def read(self, first: int) -> tuple[int, Matrix]:
        """Samples from ``first`` on that are still in the ring, shape (N, 4), and the number of the first of them."""
        head = self.head
        start = max(first, head - CAPACITY * 7 // 8)  # the oldest may be overwritten meanwhile
        return start, np.ctypeslib.as_array(self.ring)[np.arange(start, head) % CAPACITY]

    @property
    def last(self) -> tuple[float, ...]:
        """The last sample; zeros before the first one."""
        return tuple(self.ring[(self.head - 1) % CAPACITY])

    def log(self, message: str) -> None:
        """Add an event with its time."""
        self.texts[self.events % EVENTS].value = f"{self.last[0]:.3f} s: {message}"[:LONGEST]
        self.events += 1

    def last_events(self) -> list[str]:
        """The last events, the oldest first."""
        return [self.texts[i % EVENTS].value for i in range(max(0, self.events - EVENTS), self.events)]

    def timing(self, rate: float) -> str:
        """Samples, service times and missed deadlines so far, in a sentence."""
        counts = np.cumsum(self.service)
        median, tail = (EDGES_US[np.searchsorted(counts, share * counts[-1])] for share in (0.5, 0.999))
        service = f" service {median:.3g} µs at the median and {tail:.3g} µs at p99.9;" if counts[-1] else ""
        return (
            f"{self.head} samples at {rate:g} Hz;{service} deadlines missed: {self.missed}, and by a loop that does "
            f"nothing {self.null_missed} of {round(rate)}."
        )


def new_board() -> Board:
    """A board whose set point is the reference."""
    return RawValue(Board, FOLLOW)
