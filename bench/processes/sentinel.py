"""A fixed piece of work, timed at the start of a race, from time to time and at the end: it shows the machine drift.

    x ← Q x, 64 times, with Q orthogonal (32, 32): nothing that a solver, a problem or this project's kernels change

One *look* is some dozens of timed runs in a process of its own, on the core of the race. Its level is the median; the
drift of a race is how far the level of a look is from the median level of all looks on the same core.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from bench.processes.forked_child import ForkedChild
from bench.timing.clock import Effort, no_garbage_collection, time_call
from piezo_model.child_process import START_LIMIT_S

SIZE, TIMES = 32, 64
EFFORT = Effort(budget_s=0.004, fewest=20, most=60)
EVERY_S = 2.0
TOLERATED = 0.1
"""Drift above this is a warning."""


def work() -> list[int]:
    """Nanoseconds of each run of the work, after one that does not count."""
    Q = np.linalg.qr(np.cos(np.arange(SIZE * SIZE, dtype=np.float64)).reshape(SIZE, SIZE))[0]

    def run() -> None:
        x = np.ones(SIZE)
        for _ in range(TIMES):
            x = Q @ x

    run()
    found: list[int] = []
    with no_garbage_collection():
        while EFFORT.goes_on(len(found), sum(found)):
            found.append(time_call(run))
    return found


@dataclass
class Sentinel:
    """Looks at one core."""

    core: int
    looks: list[tuple[float, list[int]]] = field(default_factory=list)
    """When (seconds since the epoch) and nanoseconds of each run."""

    def __post_init__(self) -> None:
        self._child = ForkedChild()

    def look(self, unless_within_s: float = 0.0) -> None:
        """Time the work, unless the last look is less than so many seconds ago."""
        if not self.looks or time.time() - self.looks[-1][0] >= unless_within_s:
            if not self._child.is_running:
                self._child.call(START_LIMIT_S, os.sched_setaffinity, 0, {self.core})
            self.looks.append((time.time(), self._child.call(START_LIMIT_S, work)))

    def taken(self) -> list[tuple[float, list[int]]]:
        """The looks so far, which it then forgets."""
        looks, self.looks = self.looks, []
        return looks

    def close(self) -> None:
        """End the process."""
        self._child.__exit__(None, None, None)


def table(notes: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """One row a look from notes with ``host``, ``core`` and ``sentinel`` (looks): raw times, level and its ratio."""
    rows = [(note["host"], note["core"], when, np.array(ns, dtype=np.int64), float(np.median(ns)))
            for note in notes for when, ns in note["sentinel"]]
    looks = pd.DataFrame(rows, columns=["host", "core", "at_s", "ns", "level_ns"]).sort_values("at_s", ignore_index=True)
    looks["ratio"] = looks.level_ns / looks.groupby(["host", "core"]).level_ns.transform("median")
    return looks


def drift(looks: pd.DataFrame) -> float:
    """The largest distance of a level from the median level, as a share of it.

    Examples
    --------
    >>> notes = [{"host": "a", "core": 0, "sentinel": [(0.0, [100]), (1.0, [100]), (2.0, [112])]}]
    >>> round(drift(table(notes)), 9)
    0.12
    """
    return float((looks.ratio - 1.0).abs().max()) if len(looks) else 0.0


def sentences(looks: pd.DataFrame) -> list[str]:
    """A warning where the machine drifted."""
    if drift(looks) <= TOLERATED:
        return []
    return [f"The machine drifted: a fixed piece of work took from {100 * (looks.ratio.min() - 1):+.0f} % to "
            f"{100 * (looks.ratio.max() - 1):+.0f} % of its median time in the course of the run, so a difference of that "
            f"size between two rows may be the machine's."]
