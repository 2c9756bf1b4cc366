"""A fixed piece of work, timed at the start of a race, from time to time and at the end: it shows the machine drift.

    x ← Q x, 64 times, with Q orthogonal (32, 32): nothing that a solver, a problem or this project's kernels change

One *sample* is some dozens of timed runs in a process of its own, on the core of the race; its level is their median.
What slows a core is of two kinds, which are told apart. Neighbours: whoever has the other thread of the same core slows
it to two thirds or half of its speed for milliseconds to seconds at a time, and no counter of a virtual machine shows
that; hence the share of the samples that are slow. The *drift* of a race is of what remains in a figure, a median over
problems that are spread over the race:

    max |median level of a fifth of the samples / median level of all − 1|,    over the samples of each core in order of
    time
"""

import os
import time
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.processes.forked_child import ForkedChild
from bench.timing.clock import Effort, no_garbage_collection, time_call
from piezo_model.child_process import START_LIMIT_S

SIZE, TIMES = 32, 64
EFFORT = Effort(budget_s=0.004, fewest=20, most=60)
EVERY_S = 2.0
TOLERATED = 0.1
"""Largest drift without a warning; a sample that takes longer than undisturbed ones by this share is slow."""
FIFTHS = 5
UNDISTURBED = 0.1
"""The share of the samples, the quickest of a core, that are taken as undisturbed."""
TOLERATED_SLOW = 0.05
"""A larger share of slow samples is a warning."""


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


class Sentinel(ForkedChild):
    """Samples of one core; ``samples`` are when (seconds since the epoch) and nanoseconds of each run."""

    def __init__(self, core: int | None) -> None:
        super().__init__()
        self.core, self.samples = core, list[tuple[float, list[int]]]()

    def sample(self, unless_within_s: float = 0.0) -> None:
        """Time the work, unless the last sample is less than so many seconds ago."""
        if not self.samples or time.time() - self.samples[-1][0] >= unless_within_s:
            if not self.is_running and self.core is not None:
                self.call(START_LIMIT_S, os.sched_setaffinity, 0, {self.core})
            self.samples.append((time.time(), self.call(START_LIMIT_S, work)))

    def taken(self) -> list[tuple[float, list[int]]]:
        """The samples so far, which it then forgets."""
        samples, self.samples = self.samples, []
        return samples


def table(notes: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """One row a sample from notes with ``host``, ``core`` and ``sentinel``: raw times, level and its ratio."""
    rows = [
        (note["host"], note["core"], when, np.array(ns, dtype=np.int64), float(np.median(ns)))
        for note in notes
        for when, ns in note["sentinel"]
    ]
    samples = pd.DataFrame(rows, columns=["host", "core", "at_s", "ns", "level_ns"]).sort_values(
        "at_s", ignore_index=True
    )
    samples["ratio"] = samples.level_ns / samples.groupby(["host", "core"]).level_ns.transform("median")
    return samples


def drift(samples: pd.DataFrame) -> float:
    """How far the median level of a fifth of the samples on a core is from that of all of them, at most, as a share of
    it.

    Examples
    --------
    >>> levels = [100, 100, 190, 100, 100, 100, 112, 112, 180, 100]
    >>> notes = [{"host": "a", "core": 0, "sentinel": [(float(i), [level]) for i, level in enumerate(levels)]}]
    >>> round(drift(table(notes)), 9)
    0.45
    """
    return float(np.abs(_of_fifths(samples) - 1.0).max(initial=0.0))


def _of_fifths(samples: pd.DataFrame) -> NDArray[np.float64]:
    """The median ratio in each fifth of the samples on each core; of each sample where there are fewer."""
    return np.array(
        [
            np.median(part)
            for _, core in samples.groupby(["host", "core"])
            for part in np.array_split(core.ratio.to_numpy(), FIFTHS)
            if part.size
        ]
    )


def sentences(samples: pd.DataFrame) -> list[str]:
    """A warning where the machine drifted, and one where it was slow now and then."""
    if samples.empty:
        return []
    found = []
    if drift(samples) > TOLERATED:
        fifths = 100.0 * (_of_fifths(samples) - 1.0)
        found.append(
            f"The machine drifted: a fixed piece of work was timed {len(samples)} times in the course of the "
            "run, and the medians of the "
            f"fifths of these differ by {fifths.min():+.0f} % to {fifths.max():+.0f} % from that of all, so a "
            "difference of that size between two figures may be the machine's."
        )
    more = samples.ratio / samples.groupby(["host", "core"]).ratio.transform("quantile", UNDISTURBED) - 1.0
    if (slow := float((more > TOLERATED).mean())) > TOLERATED_SLOW:
        found.append(
            f"The machine was slow now and then: a fixed piece of work took over {100.0 * TOLERATED:.0f} % "
            "longer than when undisturbed in "
            f"{100.0 * slow:.0f} % of {len(samples)} trials, at most {100.0 * more.max():.0f} % longer, as "
            "where a neighbour uses the same core, so the times of a single row may be too long by as much."
        )
    return found
