"""What a bank of compensators costs, a sample of an actuator against their number:
``python examples/performance/bank.py``.

``bank.py COUNT [RATE_HZ] [SECONDS] [THREADS]`` steps a bank of so many in real time instead. Step k is due at t0 + k T,
as of
:mod:`bench.timing.schedule`. Beside it stands a null step, which takes the bank's median by watching the clock on the
same schedule: what that takes longer is the machine's floor.
"""

import sys
import time
from collections.abc import Callable
from time import perf_counter_ns

import numpy as np

from bench.report.console import console, print_table
from bench.timing.clock import no_garbage_collection
from bench.timing.percentiles import QUANTILES, tail_cells
from bench.timing.schedule import LEAD_NS, wait_until
from piezo_model import CompensatorBank, ModelStructure
from solvers.arrays import Nanoseconds, Vector
from solvers.core import BUILT_WITH

Step = Callable[[Vector, Vector], Vector]
COUNTS = (8, 80, 800, 2000, 7000, 10_000)
OPTIMA_PER_S = (10.0, 100.0)
REPEATS = 8


def structure(sample_time: float) -> ModelStructure:
    """d = 18 with three creep rates."""
    return ModelStructure.equidistant(5, 3, (0.0, 150.0), (-20.0, 20.0), (10.0, 1.0, 0.1), sample_time)


class Loop:
    """Sines of another phase for each actuator, and actuators that are curved: cheap beside the bank."""

    def __init__(self, count: int, cycle_samples: float) -> None:
        phase = np.arange(count, dtype=np.float64)
        self.rate, self.cos, self.sin = 2.0 * np.pi / cycle_samples, 15.0 * np.cos(phase), 15.0 * np.sin(phase)
        self.y, self.k = np.full(count, np.nan), 0

    def reference(self) -> Vector:
        """Of the coming sample."""
        self.k += 1
        reference: Vector = np.sin(self.rate * self.k) * self.cos + np.cos(self.rate * self.k) * self.sin
        return reference

    def drive(self, x: Vector) -> None:
        """Drives (count,), whose outputs come with the next step."""
        u = (x - 75.0) / 75.0
        self.y = u * (20.0 + 2.0 * u)


def cost(count: int, optima_per_s: float, sample_time: float = 1.25e-3) -> tuple[float, float]:
    """Nanoseconds of an actuator and sample where all of them learn, and bytes of an actuator.

    Each sample of the interval has its own share of the work: the fastest of each, and their mean.
    """
    bank, loop = CompensatorBank(structure(sample_time), count, hand_over_s=1.0 / optima_per_s), Loop(count, 320.0)
    times = []
    for _ in range(240 + REPEATS * bank.interval):
        y_ref = loop.reference()
        begin = perf_counter_ns()
        x = bank.step(y_ref, loop.y)
        times.append(perf_counter_ns() - begin)
        loop.drive(x)
    share = np.array(times[-REPEATS * bank.interval :]).reshape(REPEATS, -1).min(axis=0)
    return share.mean() / count, bank._core.block.size / count


def paced(step: Step, loop: Loop, samples: int, period_ns: int) -> tuple[Nanoseconds, Nanoseconds]:
    """Nanoseconds of each step from its begin, and from the moment that it was due."""
    service, response = np.zeros(samples, np.int64), np.zeros(samples, np.int64)
    start = perf_counter_ns() + LEAD_NS
    for k in range(samples):
        y_ref, moment = loop.reference(), start + k * period_ns
        wait_until(moment, perf_counter_ns, time.sleep)
        begin = perf_counter_ns()
        x = step(y_ref, loop.y)
        end = perf_counter_ns()
        service[k], response[k] = end - begin, end - moment
        loop.drive(x)
    return service, response


def in_real_time(count: int, rate_Hz: float = 2000.0, seconds: float = 20.0, threads: float = 1.0) -> None:
    """Step a bank, then the null step, and print the distributions."""
    s, period_ns, samples = structure(1.0 / rate_Hz), round(1e9 / rate_Hz), max(1, round(seconds * rate_Hz))
    bank, loop = (
        CompensatorBank(s, count, hand_over_s=1.0 / OPTIMA_PER_S[0], threads=round(threads)),
        Loop(count, rate_Hz / 2.5),
    )
    for _ in range(s.samples(0.1) + 2 * bank.interval):
        loop.drive(bank.step(loop.reference(), loop.y))
    with no_garbage_collection():
        ours = paced(bank.step, loop, samples, period_ns)
        wait_ns, idle = int(np.median(ours[0])), np.full(count, 75.0)

        def nothing(y_ref: Vector, y: Vector) -> Vector:
            end = perf_counter_ns() + wait_ns
            while perf_counter_ns() < end:
                pass
            return idle

        floor = paced(nothing, loop, samples, period_ns)
    print_table(
        ("a step, µs", "p50", "p99", "p99.9", "max", "steps beyond the period", "ended late"),
        [
            (
                what,
                *tail_cells(service / 1e3, QUANTILES[:3]),
                *(f"{100.0 * float(np.mean(ns > period_ns)):.3f} %" for ns in (service, response)),
            )
            for what, (service, response) in (
                (f"a bank of {count}, {threads:g} threads", ours),
                ("  a null step as long, the machine's floor", floor),
            )
        ],
    )
    console.print(
        f"Period {1e6 / rate_Hz:.0f} µs, {OPTIMA_PER_S[0]:g} exact optima a second of each, {seconds:g} s "
        f"each; {BUILT_WITH}."
    )


def by_count(counts: tuple[int, ...] = COUNTS) -> None:
    """Print the cost against the number of actuators."""
    rows = []
    for count in counts:
        costs = [cost(count, optima) for optima in OPTIMA_PER_S]
        rows.append((f"{count}", *(f"{ns:.1f}" for ns, _ in costs), f"{costs[0][1]:.0f}"))
    print_table(
        (
            "actuators of a bank",
            *(f"{optima:g} optima a second, ns a sample of one" for optima in OPTIMA_PER_S),
            "bytes of one",
        ),
        rows,
    )


if __name__ == "__main__":
    in_real_time(int(sys.argv[1]), *map(float, sys.argv[2:])) if sys.argv[1:] else by_count()
