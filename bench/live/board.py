"""Memory that the processes of a live run share, without locks.

The loop writes samples into a ring buffer and counts them; readers copy the newest ones and never delay the loop. The
set point and the request to stop go the other way. Every number has one writer at a time.
"""

import math
from enum import IntEnum
from multiprocessing.sharedctypes import RawArray
from typing import Any, Self

import numpy as np

from solvers.arrays import Matrix, Vector

RING_S = 30.0
"""Seconds of samples in the ring buffer: the longest delay of the disk that loses none."""
EVENTS, TEXT_BYTES = 64, 480
BINS, BINS_PER_DECADE, FIRST_NS = 160, 20, 100
"""Histogram of service times: number and width of its bins, upper edge of the first."""
FOLLOW = math.inf
"""Set point that selects the reference."""


class State(IntEnum):
    """State of the loop."""

    STARTING = 0
    FOLLOWING = 1
    RAMPING = 2
    ENDED = 3


INTEGERS = (
    "head",  # samples written
    "state",
    "missed",  # deadlines, those of skipped due times too
    "null_missed",  # deadlines that the null loop missed, among null_samples
    "null_samples",
    "events",
    "hand_overs",
    "stop",  # 1 to stop
    "followed",  # samples before the ramp to rest
    "failed",  # 1 if the stage failed
    "rescued",  # 1 if the process that stood by has taken over
    "over",  # 1 if no process drives the stage any more
    "core",  # of the loop, once it has one
)


class Board:
    """The shared memory; a process started with the board shares it.

    Each of ``INTEGERS`` is read as an attribute and written by :meth:`set`; ``drive`` and ``set_point`` are arrays of
    one number, ``service`` counts service times by bin.
    """

    def __init__(self, rate: float, memory: Any = None) -> None:
        self._rate, self.capacity = rate, max(1024, round(RING_S * rate))
        layout = np.dtype(
            [
                ("integers", np.int64, (len(INTEGERS),)),
                ("ring", np.float64, (self.capacity, 4)),
                ("log", f"S{TEXT_BYTES}", (EVENTS,)),
                ("reason", f"S{TEXT_BYTES}", (1,)),
                ("service", np.int64, (BINS,)),
                ("drive", np.float64, (1,)),
                ("set_point", np.float64, (1,)),
            ],
            align=True,
        )
        self.memory = RawArray("B", layout.itemsize) if memory is None else memory
        shared = np.frombuffer(self.memory, layout)
        self._fields = {name: shared[name][0] for name in layout.fields or ()}
        self._integers, self._ring = self._fields["integers"], self._fields["ring"]
        self.service, self.drive, self.set_point = (self._fields[name] for name in ("service", "drive", "set_point"))
        if memory is None:
            self.set_point[0] = FOLLOW

    def __reduce__(self) -> tuple[type[Self], tuple[Any, ...]]:
        return type(self), (self._rate, self.memory)

    def __getattr__(self, name: str) -> int:
        if name not in INTEGERS:
            raise AttributeError(name)
        return int(self._integers[INTEGERS.index(name)])

    def set(self, **integers: int) -> None:
        """Set some of ``INTEGERS``."""
        for name, value in integers.items():
            self._integers[INTEGERS.index(name)] = value

    def write(self, sample: tuple[float, float, float, float]) -> None:
        """Write the next sample and count it."""
        head = self.head
        self._ring[head % self.capacity] = sample
        self.set(head=head + 1)

    def read(self, first: int) -> tuple[int, Matrix]:
        """Samples from ``first`` on that are still in the ring, shape (N, 4): time in s, reference, drive and measured
        output; and the number of the first of them."""
        head = self.head
        start = max(first, head - self.capacity + self.capacity // 8)  # the oldest may be overwritten meanwhile
        return start, self._ring[np.arange(start, head) % self.capacity]

    @property
    def last(self) -> Vector:
        """The last sample, shape (4,); zeros before the first one."""
        return self._ring[(self.head - 1) % self.capacity]

    def log(self, message: str) -> None:
        """Add an event with its time."""
        self._fields["log"][self.events % EVENTS] = f"{self.last[0]:.3f} s: {message}".encode()[:TEXT_BYTES]
        self.set(events=self.events + 1)

    def last_events(self) -> list[str]:
        """The last events, the oldest first."""
        count = self.events
        return [self._fields["log"][i % EVENTS].decode(errors="replace") for i in range(max(0, count - EVENTS), count)]

    def timing(self) -> str:
        """Samples, service times and missed deadlines so far, in a sentence."""
        counts, edges = np.cumsum(self.service), edges_us()
        median, tail = (edges[1 + np.searchsorted(counts, share * counts[-1])] for share in (0.5, 0.999))
        service = f" service {median:.3g} µs at the median and {tail:.3g} µs at p99.9;" if counts[-1] else ""
        return (
            f"{self.head} samples at {self._rate:g} Hz;{service} deadlines missed: {self.missed}, and by a loop that "
            f"does nothing {self.null_missed} of {self.null_samples}."
        )

    @property
    def reason(self) -> str:
        """Why the run ends, or the stage could not be opened; empty until then."""
        return str(self._fields["reason"][0].decode(errors="replace"))

    @reason.setter
    def reason(self, text: str) -> None:
        self._fields["reason"][0] = text.encode()[:TEXT_BYTES]


def bin_of(nanoseconds: int) -> int:
    """Bin of a time in the histogram."""
    return min(BINS - 1, int(BINS_PER_DECADE * math.log10(nanoseconds / FIRST_NS))) if nanoseconds > FIRST_NS else 0


def edges_us() -> Vector:
    """Edges of the histogram's bins, shape (BINS + 1,)."""
    return 1e-3 * FIRST_NS * 10.0 ** (np.arange(BINS + 1) / BINS_PER_DECADE)


def rms(error: Vector) -> float:
    """RMS of the numbers in an array; NaN if there is none."""
    known = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known**2))) if known.size else math.nan
