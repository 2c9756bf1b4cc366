"""The exported step in real time: an absolute schedule, and what the machine made of it.

Sample k is due at t₀ + k T. The loop sleeps until then (``clock_nanosleep`` with an absolute time, SCHED_FIFO and
locked memory where the system allows), wakes up late by the *wake-up latency*, takes its step, the *service time*, and
ends at the
*response time* after t₀ + k T. A deadline is missed where that is above T. A step that does nothing on the same
schedule is the floor of the machine.
"""

import os
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bench.export.building import FAST, build, tool, write_sources
from bench.export.settings import ExportError, ExportSettings
from bench.export.step_cost import StepCost
from bench.timing.percentiles import QUANTILES, needed, percentile
from piezo_model import HysteresisCreepModel
from solvers.arrays import Nanoseconds

MET = 0.9999
SEARCH_S = 3.0
"""Seconds of each trial in the search for the highest rate, more where the samples would be too few."""
SLOWEST_HZ, FASTEST_HZ = 500.0, 1_000_000.0


@dataclass(frozen=True)
class Paced:
    """One run on the schedule."""

    rate_Hz: float
    wake_ns: Nanoseconds
    service_ns: Nanoseconds
    response_ns: Nanoseconds
    """Shape (N,), like those before it."""
    allowed: dict[str, str]
    """What the system allowed: memory, core, fifo → "yes" or why not."""

    @property
    def missed(self) -> int:
        """Samples whose response came after the next was due."""
        return int(np.count_nonzero(self.response_ns > 1e9 / self.rate_Hz))

    @property
    def met(self) -> float:
        """Share of deadlines met."""
        return 1.0 - self.missed / self.response_ns.size


class RealTime:
    """The exported step, built for this machine; ExportError where there is no C compiler, or it does not build.

    It asks for a priority of SCHED_FIFO, 1 to 99, unless that is 0, and is pinned to a core, by default the last that
    may be used.
    """

    def __init__(
        self, model: HysteresisCreepModel, settings: ExportSettings, priority: int = 80, core: int | None = None
    ) -> None:
        compiler = tool("cc", "gcc", "clang")
        self._priority, self._core = priority, max(os.sched_getaffinity(0)) if core is None else core
        self._folder = tempfile.TemporaryDirectory(prefix="piezobench-realtime-")
        try:
            write_sources(Path(self._folder.name), model, settings)
            self._program = build(Path(self._folder.name), "loop", compiler, FAST)
        except BaseException:
            self._folder.cleanup()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()

    def run(self, rate_Hz: float, seconds: float, null: bool = False) -> Paced:
        """Run the step, or one that does nothing, at a rate; ExportError where the time is shorter than a sampling
        period."""
        if rate_Hz * seconds < 1.0:
            raise ExportError(
                f"{seconds:g} s at {rate_Hz:g} Hz hold no sample; the shortest run is {1.0 / rate_Hz:g} s"
            )
        out = Path(self._folder.name) / "times"
        words = [str(self._program), repr(rate_Hz), repr(seconds), str(self._priority), str(self._core), str(out)]
        done = subprocess.run([*words, *(["null"] if null else [])], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise ExportError(f"the real-time program ended with status {done.returncode}: {done.stderr.strip()[:300]}")
        wake, end = np.fromfile(out, dtype=np.int64).reshape(-1, 2).T
        allowed = dict(line.split(" ", 1) for line in done.stdout.splitlines())
        return Paced(rate_Hz, wake, end - wake, end, allowed)

    def highest_rate(
        self, from_Hz: float, seconds: float = SEARCH_S, told: Callable[[float, float], None] = lambda rate, met: None
    ) -> float:
        """Highest rate found at which 99.99 % of the deadlines are met; 0 where none was.

        A trial is no shorter than the sample that p99.99 needs. ``told`` hears of each rate and its share.
        """

        def holds(rate: float) -> bool:
            met = self.run(rate, max(seconds, needed(MET) / rate)).met
            told(rate, met)
            return met >= MET

        return highest(holds, from_Hz)


def highest(
    holds: Callable[[float], bool], start: float, slowest: float = SLOWEST_HZ, fastest: float = FASTEST_HZ
) -> float:
    """Highest rate that holds, to a quarter of an octave; 0 where none does.

    Rates go up by half an octave until one fails (or down until one holds), then once by half of that.

    Examples
    --------
    >>> round(highest(lambda rate: rate <= 50_000.0, 8000.0))
    45255
    """
    step, rate = 2.0**0.5, start
    if holds(rate):
        while rate * step <= fastest and holds(rate * step):
            rate *= step
    else:
        rate /= step
        while rate >= slowest and not holds(rate):
            rate /= step
        if rate < slowest:
            return 0.0
    middle = rate * step**0.5
    return middle if middle <= fastest and holds(middle) else rate


def histogram(times_ns: Nanoseconds) -> dict[float, int]:
    """Counts by upper bound in µs: powers of two from 1/8 µs on, from the first to the last that holds any.

    Examples
    --------
    >>> histogram(np.array([100, 200, 900]))
    {0.125: 1, 0.25: 1, 0.5: 0, 1.0: 1}
    """
    octave = np.maximum(np.ceil(np.log2(np.maximum(times_ns, 1) / 125.0)), 0.0).astype(int)
    counts = np.bincount(octave)
    first = int(np.flatnonzero(counts)[0])
    return {0.125 * 2.0**k: int(counts[k]) for k in range(first, counts.size)}


@dataclass(frozen=True)
class RealTimeFigures:
    """What the machine made of the schedule, a step that does nothing beside it, and what a step costs."""

    step: Paced
    null: Paced
    highest_rate_Hz: float | None
    """None where it was not searched for."""
    cost: StepCost | None

    @property
    def times_ns(self) -> dict[str, Nanoseconds]:
        """Times by name."""
        return {
            "wake-up": self.step.wake_ns,
            "service": self.step.service_ns,
            "response": self.step.response_ns,
            "null response": self.null.response_ns,
        }

    @property
    def times_us(self) -> dict[str, NDArray[np.float64]]:
        """The same in µs."""
        return {name: np.asarray(1e-3 * ns, dtype=np.float64) for name, ns in self.times_ns.items()}

    @property
    def histograms(self) -> dict[str, dict[float, int]]:
        """The same counted by :func:`histogram`."""
        return {name: histogram(ns) for name, ns in self.times_ns.items()}

    def to_dict(self) -> dict[str, Any]:
        """As JSON can hold it."""
        tails = {
            name: {p.name: p.value for p in (percentile(us, q) for q in QUANTILES)} | {"max": float(us.max())}
            for name, us in self.times_us.items()
        }
        return {
            "rate_Hz": self.step.rate_Hz,
            "samples": self.step.response_ns.size,
            "missed": self.step.missed,
            "null_missed": self.null.missed,
            "highest_rate_Hz": self.highest_rate_Hz,
            "allowed": self.step.allowed,
            "us": tails,
            "histograms_us": {
                name: {f"{bound:g}": n for bound, n in count.items()} for name, count in self.histograms.items()
            },
            "cost": None if self.cost is None else asdict(self.cost),
        }
