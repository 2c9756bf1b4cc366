"""What the processes of a live run share: one block of memory, written without waiting for anybody.

The loop writes samples into a ring and counts them; whoever reads them takes what is there and never holds the loop up.
Commands go the other way: a command is written whole before it is counted. Every entry has one writer.
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
"""Seconds that the ring holds; a recorder that died has so long to come back."""
MOST_WEIGHTS = 256
EVENTS, EVENT_BYTES, COMMANDS = 64, 240, 64
BINS, BINS_A_DECADE, FIRST_NS = 160, 20, 100
"""Of the histograms."""


class State(IntEnum):
    """What the loop is doing."""

    STARTING = 0
    FOLLOWING = 1
    RAMPING = 2
    ENDED = 3


class Command(IntEnum):
    """What the page may ask for."""

    LEARN = 0
    """1 to learn, 0 to wait."""
    HOLD = 1
    """Stay at the present reference."""
    SET_POINT = 2
    FOLLOW = 3
    """Go on with the reference."""
    STOP = 4


COUNTS = (
    "head",
    "state",
    "beat_ns",
    "missed",
    "late_null",
    "null_samples",
    "events",
    "commands",
    "weights",
    "hand_overs",
    "learning",
    "stop",
    "core",
    "page",
    "followed",
)
"""Whole numbers: samples written, state, time of the last one, deadlines missed, those of the null loop, how many of
each follow, the core of the loop, 1 once the page answers, and samples before the ramp to rest."""


class Board:
    """The block, a file in memory that the first process makes and the others open; a whole number of ``COUNTS`` is an
    attribute."""

    def __init__(self, path: Path, rate: float, make: bool = False) -> None:
        self.capacity = max(1024, round(RING_S * rate))
        whole = np.dtype(
            [
                ("counts", np.int64, (len(COUNTS),)),
                ("samples", np.float64, (self.capacity, len(COLUMNS))),
                ("weights", np.float64, (MOST_WEIGHTS,)),
                ("events", f"S{EVENT_BYTES}", (EVENTS,)),
                ("commands", np.float64, (COMMANDS, 2)),
                ("service", np.int64, (BINS,)),
                ("response", np.int64, (BINS,)),
                ("null", np.int64, (BINS,)),
                ("frame", np.float64, (5,)),
                ("drive", np.float64, (1,)),
            ],
            align=True,
        )
        self._all = np.memmap(path, whole, "w+" if make else "r+", shape=(1,))
        (
            self._counts,
            self._samples,
            self._weights,
            self._events,
            self._commands,
            self.service,
            self.response,
            self.null,
            self.frame,
            self.drive,
        ) = (np.asarray(self._all[field][0]) for field in whole.names or ())

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

    def say(self, text: str) -> None:
        """Add an event; the time goes before it."""
        moment = f"{self.read(self.head - 1)[1][-1, 0] if self.head else 0.0:.3f} s: {text}"
        self._events[self.events % EVENTS] = moment.encode()[:EVENT_BYTES]
        self.note(events=self.events + 1)

    def said(self) -> list[str]:
        """The last events, the oldest first."""
        count = self.events
        return [self._events[i % EVENTS].decode(errors="replace") for i in range(max(0, count - EVENTS), count)]

    def ask(self, command: Command, value: float = 0.0) -> None:
        """Ask the loop for something."""
        self._commands[self.commands % COMMANDS] = command, value
        self.note(commands=self.commands + 1)

    def asked(self, since: int) -> list[tuple[Command, float]]:
        """What was asked since so many commands."""
        return [
            (Command(int(kind)), float(value))
            for kind, value in (self._commands[i % COMMANDS] for i in range(since, self.commands))
        ]

    def show_model(self, model: HysteresisCreepModel) -> None:
        """Show weights, centres and scales of the model in use."""
        s, size = model.structure, min(model.weights.size, MOST_WEIGHTS)
        self._weights[:size] = model.weights[:size]
        self.frame[:] = s.x_centre, s.x_scale, s.y_centre, s.y_scale, s.offset
        self.note(weights=size)

    def shown_model(self, first: HysteresisCreepModel) -> HysteresisCreepModel:
        """The model in use, which began as the first."""
        if not self.weights:
            return first
        x_centre, x_scale, y_centre, y_scale, offset = self.frame.tolist()
        structure = replace(
            first.structure, x_centre=x_centre, x_scale=x_scale, y_centre=y_centre, y_scale=y_scale, offset=bool(offset)
        )
        return HysteresisCreepModel.from_weights(structure, self._weights[: self.weights].copy())


def bin_of(nanoseconds: int) -> int:
    """Where a time is counted in a histogram."""
    return min(BINS - 1, int(BINS_A_DECADE * math.log10(nanoseconds / FIRST_NS))) if nanoseconds > FIRST_NS else 0


def edges_us() -> Vector:
    """Edges of the histograms' bins, shape (BINS + 1,)."""
    return 1e-3 * FIRST_NS * 10.0 ** (np.arange(BINS + 1) / BINS_A_DECADE)
