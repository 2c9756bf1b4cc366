"""A reference workload, timed at the start, in the course and at the end of a race, that shows the machine's drift.

    x ← Q x, 64 times, with Q orthogonal (32, 32): independent of solvers, problems and this project's kernels

One *sample* is some dozens of timed runs in the null solver's process, on the core of the race; its level is their
median. Two
kinds of slowness are distinguished. A neighbour on the other thread of the same core slows it to two thirds or half of
its speed for milliseconds to seconds, which no counter of a virtual machine shows; it is measured by the share of slow
samples. The *drift* of a race is the slowness that remains in a median over problems that are spread over the race:

    max |median level of a fifth of the samples / median level of all − 1|,    over the samples of each core in order of
    time
"""

import time
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.messages.task import Outcome
from bench.processes.solver_child import SolverChild
from bench.timing.clock import Effort, no_garbage_collection, time_call

SIZE, TIMES = 32, 64
EFFORT = Effort(budget_s=0.004, fewest=20, most=60)
EVERY_S = 2.0
TOLERATED = 0.1
"""Largest drift without a warning; a sample is slow if it exceeds the undisturbed level by more than this share."""
FIFTHS = 5
UNDISTURBED = 0.1
"""Share of the samples of a core, the fastest ones, that count as undisturbed."""
TOLERATED_SLOW = 0.05
"""Largest share of slow samples without a warning."""


def work(*_: object) -> Outcome:
    """Nanoseconds of each run of the work, after an untimed run."""
    Q = np.linalg.qr(np.cos(np.arange(SIZE * SIZE, dtype=np.float64)).reshape(SIZE, SIZE))[0]

    def run() -> None:
        x = np.ones(SIZE)
        for _ in range(TIMES):
            x = Q @ x

    run()
    times_ns: list[int] = []
    with no_garbage_collection():
        while EFFORT.goes_on(len(times_ns), sum(times_ns)):
            times_ns.append(time_call(run))
    return Outcome(times={"work": np.array(times_ns, dtype=np.int64)})


class Sentinel:
    """Samples the core of a process; a sample is its time in seconds since the epoch and the nanoseconds of each run.
    There is none while the process is lost."""

    def __init__(self, child: SolverChild) -> None:
        self._child, self.samples = child, list[tuple[float, list[int]]]()

    def sample(self, unless_within_s: float = 0.0) -> None:
        """Time the work, unless the last sample is younger than ``unless_within_s``."""
        if not self.samples or time.time() - self.samples[-1][0] >= unless_within_s:
            times = self._child.ask(work).times
            self.samples += [(time.time(), ns.tolist()) for ns in times.values()]


def table(notes: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """One row for each sample in notes with ``host``, ``core`` and ``sentinel``; ``ratio`` is level over median."""
    rows = [
        (note["host"], note["core"], when, np.array(ns, dtype=np.int64), float(np.median(ns)))
        for note in notes
        for when, ns in note["sentinel"]
    ]
    samples = pd.DataFrame(rows, columns=["host", "core", "at_s", "ns", "level_ns"]).sort_values(
        "at_s", ignore_index=True
    )
    return samples.assign(ratio=samples.level_ns / samples.groupby(["host", "core"]).level_ns.transform("median"))


def drift(samples: pd.DataFrame) -> float:
    """Largest relative deviation of the median level of a fifth of a core's samples from that of all its samples.

    Examples
    --------
    >>> levels = [100, 100, 190, 100, 100, 100, 112, 112, 180, 100]
    >>> notes = [{"host": "a", "core": 0, "sentinel": [(float(i), [level]) for i, level in enumerate(levels)]}]
    >>> round(drift(table(notes)), 9)
    0.45
    """
    return float(np.abs(_of_fifths(samples) - 1.0).max(initial=0.0))


def _of_fifths(samples: pd.DataFrame) -> NDArray[np.float64]:
    """The median ratio in each fifth of the samples of each core."""
    return np.array(
        [
            np.median(fifth)
            for _, core in samples.groupby(["host", "core"])
            for fifth in np.array_split(core.ratio.to_numpy(), FIFTHS)
            if fifth.size
        ]
    )


def sentences(samples: pd.DataFrame) -> list[str]:
    """A warning if the machine drifted, and one if it was slow too often."""
    if samples.empty:
        return []
    fifths = 100.0 * (_of_fifths(samples) - 1.0)
    more = samples.ratio / samples.groupby(["host", "core"]).ratio.transform("quantile", UNDISTURBED) - 1.0
    slow = float((more > TOLERATED).mean())
    found = (
        (
            drift(samples) > TOLERATED,
            f"The speed of the machine drifted: of {len(samples)} timings of a reference workload, the medians of the "
            f"fifths of the run differ by {fifths.min():+.0f} % to {fifths.max():+.0f} % from that of all, so "
            "differences of that size between two figures may be due to the machine.",
        ),
        (
            slow > TOLERATED_SLOW,
            f"The machine was slow at times: a reference workload took over {100.0 * TOLERATED:.0f} % longer than when "
            f"undisturbed in {100.0 * slow:.0f} % of {len(samples)} trials, at most {100.0 * more.max():.0f} % longer, "
            "as when a neighbour uses the same core, so the times of a single row may be too long by as much.",
        ),
    )
    return [sentence for is_disturbed, sentence in found if is_disturbed]
