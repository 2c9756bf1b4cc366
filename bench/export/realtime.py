"""The exported step in real time, on an absolute schedule.

Sample k is due at t₀ + k T. The loop sleeps until then (``clock_nanosleep`` with an absolute time, SCHED_FIFO and
locked memory if the system allows them), wakes up late by the *wake-up latency*, needs the *service time* for its step,
and ends at the *response time* after t₀ + k T. If that exceeds T, the deadline is missed. An empty step on the same
schedule gives the machine's floor.

The program runs on a core that it claims as a race does, so that neither disturbs the other. A learner's thread shares
that core, at the next lower priority.
"""

import subprocess
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.export import building, c_source
from bench.export.settings import ExportError, ExportSettings
from bench.processes.child_process import Child
from bench.timing import cores, percentiles
from piezo_model import HysteresisCreepModel, checks
from solvers.arrays import Vector

FLAGS = ("-std=c99", "-O3", "-march=native", "-ffp-contract=fast", "-pthread")


@dataclass(frozen=True)
class RealTime:
    """A run of the exported step on the schedule, and one of an empty step."""

    rate_Hz: float
    times_us: dict[str, Vector]
    """``wake-up``, ``service`` and ``response`` of the step, and ``null response``, µs, each of shape (N,)."""
    allowed: dict[str, str]
    """memory, core, fifo → "yes" or why the system refused; with learning, counts of late offers and dropped blocks."""

    def missed(self, response: str) -> int:
        """Number of samples whose response time, of this name, exceeds the period."""
        return int(np.count_nonzero(self.times_us[response] > 1e6 / self.rate_Hz))

    @property
    def histograms(self) -> dict[str, dict[float, int]]:
        """Times by name, counted by :func:`histogram`."""
        return {name: histogram(us) for name, us in self.times_us.items()}

    def to_dict(self) -> dict[str, Any]:
        """Figures for JSON."""
        return {
            "rate_Hz": self.rate_Hz,
            "samples": self.times_us["response"].size,
            "missed": self.missed("response"),
            "null_missed": self.missed("null response"),
            "allowed": self.allowed,
            "us": {
                name: {percentiles.name(q): percentiles.percentile(us, q) for q in percentiles.QUANTILES}
                | {"max": float(us.max())}
                for name, us in self.times_us.items()
            },
            "histograms_us": {
                name: {f"{bound:g}": n for bound, n in count.items()} for name, count in self.histograms.items()
            },
        }


def real_time(
    model: HysteresisCreepModel,
    settings: ExportSettings,
    rate_Hz: float,
    seconds: float,
    priority: int = 80,
    core: int | None = None,
) -> RealTime:
    """Build the exported loop and run it at a rate, then the same with an empty step.

    It requests a priority of SCHED_FIFO, 1 to 99, or none if that is 0, and is pinned to a core, by default the last
    one that is free; while another process holds that core, it waits and prints which. ExportError if there is no C
    compiler, or the time is shorter than a sampling period.
    """
    checks.check(
        rate_Hz * seconds >= 1.0,
        f"{seconds:g} s at {rate_Hz:g} Hz hold no sample; the shortest run is {1.0 / rate_Hz:g} s",
        ExportError,
    )
    with tempfile.TemporaryDirectory(prefix="piezobench-realtime-") as name:
        folder = Path(name)
        building.write_files(folder, c_source.export(model.at(1.0 / rate_Hz), settings))
        sources = sorted(path.name for path in folder.glob("piezo*.c"))
        building.compile_c(folder, [*FLAGS, "loop.c", *sources, "-o", "loop", "-lm"], "the export")

        # a child ends with this process, however that ends, and the program with the child
        with cores.claim(core) as claimed, claimed.pinned(), Child() as child:

            def paced(*null: str) -> tuple[Vector, Vector, dict[str, str]]:
                words = ["./loop", repr(rate_Hz), repr(seconds), str(priority), str(claimed.number), "times", *null]
                done = child.call(1e6, partial(subprocess.run, cwd=folder, capture_output=True, text=True), words)
                checks.check(
                    done.returncode == 0,
                    f"the real-time program ended with status {done.returncode}: {done.stderr.strip()}",
                    ExportError,
                )
                wake, end = np.fromfile(folder / "times", dtype=np.int64).reshape(-1, 2).T / 1e3
                return wake, end, dict(line.split(" ", 1) for line in done.stdout.splitlines())

            (wake, end, allowed), (_, null, _) = paced(), paced("null")
        times = {"wake-up": wake, "service": end - wake, "response": end, "null response": null}
        return RealTime(rate_Hz, times, allowed)


def histogram(times_us: Vector) -> dict[float, int]:
    """Counts by upper bound in µs, powers of two from 1/8 µs on, from the first to the last that is not zero.

    Examples
    --------
    >>> histogram(np.array([0.1, 0.2, 0.9]))
    {0.125: 1, 0.25: 1, 0.5: 0, 1.0: 1}
    """
    counts = np.bincount(np.ceil(np.log2(np.maximum(times_us, 0.125) / 0.125)).astype(int))
    return {0.125 * 2.0**k: int(counts[k]) for k in range(int(np.flatnonzero(counts)[0]), counts.size)}
