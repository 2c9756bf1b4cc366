"""What the processes of a live run share: one block of memory, written without waiting for anybody.

The loop writes samples into a ring and counts them; whoever reads them takes what is there and never holds the loop up.
A set point, whether to learn and whether to stop go the other way.
"""

import math
from dataclasses import replace
from enum import IntEnum
from pathlib import Path

import numpy as np

from piezo_model import HysteresisCreepModel
from solvers.arrays import Matrix, Vector

COLUMNS = ("time_s", "reference", "drive", "measured")
RING_S = 30.0
"""Seconds that the ring holds; so long may the disk keep the recorder waiting."""
EVENTS, EVENT_BYTES = 64, 240
BINS, BINS_A_DECADE, FIRST_NS = 160, 20, 100
"""Of the histogram of service times."""


class State(IntEnum):
    """What the loop is doing."""

    STARTING = 0
    FOLLOWING = 1
    RAMPING = 2
    ENDED = 3


COUNTS = (
    "head",
    "state",
    "beat_ns",
    "missed",
    "late_null",
    "null_samples",
    "events",
    "hand_overs",
    "learning",
    "stop",
    "core",
    "followed",
    "failed",
)
"""Whole numbers: samples written, state, time of the last one, deadlines missed, those of the null loop, how many
events and hand-overs there were, 1 to learn and 0 to wait, 1 to stop, the core of the loop, samples before the ramp to
rest, and 1 where the stage made the end."""
FOLLOW = math.inf
"""In place of a set point: the reference."""


class Board:
    """The block, a file in memory that the first process makes and the others open; a whole number of ``COUNTS`` is an
    attribute."""

    def __init__(self, path: Path, rate: float, first: HysteresisCreepModel, make: bool = False) -> None:
        self._first = first
        self.capacity = max(1024, round(RING_S * rate))
        whole = np.dtype(
            [
                ("counts", np.int64, (len(COUNTS),)),
                ("samples", np.float64, (self.capacity, len(COLUMNS))),
                ("weights", np.float64, (first.all_weights.size,)),
                ("frame", np.float64, (5,)),
                ("events", f"S{EVENT_BYTES}", (EVENTS,)),
                ("why", f"S{EVENT_BYTES}", (1,)),
                ("service", np.int64, (BINS,)),
                ("drive", np.float64, (1,)),
                ("set_point", np.float64, (1,)),
            ],
            align=True,
        )
        shared = np.memmap(path, whole, "w+" if make else "r+", shape=(1,))
        (
            self._counts,
            self._samples,
            self._weights,
            self._frame,
            self._events,
            self._why,
            self.service,
            self.drive,
            self.set_point,
        ) = (np.asarray(shared[field][0]) for field in whole.names or ())
        if make:
            self.show_model(first)
            self.set_point[0] = FOLLOW

    def __getattr__(self, name: str) -> int:
        if name not in COUNTS:
            raise AttributeError(name)
        return int(self._counts[COUNTS.index(name)])

    def note(self, **counts: int) -> None:
        """Set whole numbers of ``COUNTS``."""
        for name, value in counts.items():
            self._counts[COUNTS.index(name)] = value

    def write(self, k: int, row: tuple[float, float, float, float]) -> None:
        """Write sample k, the next one, and count it."""
        self._samples[k % self.capacity] = row
        self._counts[0] = k + 1

    def read(self, first: int) -> tuple[int, Matrix]:
        """The samples from ``first`` on that are still there, shape (N, 4), and the number of the first of them."""
        head = self.head
        start = max(
            first, head - self.capacity + self.capacity // 8
        )  # the oldest may be written over while they are read
        return start, self._samples[np.arange(start, head) % self.capacity]

    @property
    def last(self) -> Vector:
        """The last sample, shape (4,); zeros before the first one."""
        return self._samples[(self.head - 1) % self.capacity]

    def say(self, text: str) -> None:
        """Add an event; the time goes before it."""
        self._events[self.events % EVENTS] = f"{self.last[0]:.3f} s: {text}".encode()[:EVENT_BYTES]
        self.note(events=self.events + 1)

    def said(self) -> list[str]:
        """The last events, the oldest first."""
        count = self.events
        return [self._events[i % EVENTS].decode(errors="replace") for i in range(max(0, count - EVENTS), count)]

    def end(self, why: str, failed: bool) -> None:
        """Say that the ramp to rest begins."""
        self.say(f"ramp to rest: {why}")
        self._why[0] = why.encode()[:EVENT_BYTES]
        self.note(followed=self.head, failed=failed, state=State.RAMPING)

    @property
    def why(self) -> str:
        """Why the run ends; nothing while it does not."""
        return str(self._why[0].decode(errors="replace"))

    def show_model(self, model: HysteresisCreepModel) -> None:
        """Show weights, centres and scales of the model in use."""
        s = model.structure
        self._weights[:] = model.all_weights
        self._frame[:] = s.x_centre, s.x_scale, s.y_centre, s.y_scale, s.offset

    def shown_model(self) -> HysteresisCreepModel:
        """The model in use."""
        x_centre, x_scale, y_centre, y_scale, offset = self._frame.tolist()
        structure = replace(
            self._first.structure,
            x_centre=x_centre,
            x_scale=x_scale,
            y_centre=y_centre,
            y_scale=y_scale,
            offset=bool(offset),
        )
        return HysteresisCreepModel.from_all_weights(structure, self._weights.copy())


def bin_of(nanoseconds: int) -> int:
    """Where a time is counted in the histogram."""
    return min(BINS - 1, int(BINS_A_DECADE * math.log10(nanoseconds / FIRST_NS))) if nanoseconds > FIRST_NS else 0


def edges_us() -> Vector:
    """Edges of the histogram's bins, shape (BINS + 1,)."""
    return 1e-3 * FIRST_NS * 10.0 ** (np.arange(BINS + 1) / BINS_A_DECADE)
