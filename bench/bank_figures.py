"""What a bank of compensators costs: a sample of an actuator against their number, and the steps of a bank in real time.

In real time step k is due at t0 + k T, as of :mod:`bench.timing.schedule`. Beside it stands a null step, which takes the bank's median by
watching the clock on the same schedule: what it takes longer is the machine's floor.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from time import perf_counter_ns

import numpy as np

from bench.timing.clock import no_garbage_collection
from bench.timing.percentiles import QUANTILES, tail_cells
from bench.timing.schedule import LEAD_NS, due, wait_until
from piezo_model import CompensatorBank, ModelStructure
from solvers.arrays import Nanoseconds, Vector

Step = Callable[[Vector, Vector], Vector]
COUNTS = (8, 80, 800, 2000, 7000, 10_000)
OPTIMA_PER_S = (10.0, 100.0)
REPEATS = 8
CACHED = 1.15
"""Times the lowest cost that counts as cached."""
COST_HEADINGS = ("actuators of a bank", *(f"{optima:g} optima a second, ns a sample of one" for optima in OPTIMA_PER_S), "bytes of one")
STEP_HEADINGS = ("a step, µs", "p50", "p99", "p99.9", "max", "steps beyond the period", "ended late")


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
        """What these drives bring comes with the next step."""
        u = (x - 75.0) / 75.0
        self.y = u * (20.0 + 2.0 * u)


def cost_by_count(sample_time: float = 1.25e-3) -> list[tuple[str, ...]]:
    """Rows of COST_HEADINGS: nanoseconds of an actuator and sample where all of them learn.

    Each sample of the interval has its own share of the work: the fastest of each, and their mean.
    """
    found = []
    for count in COUNTS:
        row = [f"{count}"]
        for optima in OPTIMA_PER_S:
            bank, loop = CompensatorBank(structure(sample_time), count, hand_over_s=1.0 / optima), Loop(count, 320.0)
            times = []
            for _ in range(240 + REPEATS * bank.interval):
                y_ref = loop.reference()
                begin = perf_counter_ns()
                x = bank.step(y_ref, loop.y)
                times.append(perf_counter_ns() - begin)
                loop.drive(x)
            share = np.array(times[-REPEATS * bank.interval:]).reshape(REPEATS, -1).min(axis=0)
            row.append(f"{share.mean() / count:.1f}")
        found.append((*row, f"{bank.bytes_per_actuator:.0f}"))
    return found


def where_memory_takes_over(rows: list[tuple[str, ...]]) -> str:
    """A sentence on the rows of :func:`cost_by_count`."""
    said = []
    for column, optima in enumerate(OPTIMA_PER_S, 1):
        cost = np.array([float(row[column]) for row in rows])
        lowest = int(np.argmin(cost))
        beyond = [i for i in range(lowest, len(rows)) if cost[i] > CACHED * cost[lowest]]
        said.append(f"with {optima:g} optima a second " + (
            f"between {rows[beyond[0] - 1][0]} and {rows[beyond[0]][0]} actuators" if beyond else f"not up to {rows[-1][0]} actuators"))
    return f"Memory takes over, the cost above {CACHED:g} times the lowest: {'; '.join(said)}."


def paced(step: Step, loop: Loop, samples: int, period_ns: int) -> tuple[Nanoseconds, Nanoseconds]:
    """Nanoseconds of each step from its begin, and from the moment that it was due."""
    service, response = np.zeros(samples, np.int64), np.zeros(samples, np.int64)
    start = perf_counter_ns() + LEAD_NS
    for k in range(samples):
        y_ref, moment = loop.reference(), due(start, k, period_ns)
        wait_until(moment, perf_counter_ns, time.sleep)
        begin = perf_counter_ns()
        x = step(y_ref, loop.y)
        end = perf_counter_ns()
        service[k], response[k] = end - begin, end - moment
        loop.drive(x)
    return service, response


def steps_in_real_time(count: int, rate_Hz: float, seconds: float, threads: int, optima_per_s: float) -> list[tuple[str, ...]]:
    """Rows of STEP_HEADINGS: the bank, then the null step."""
    s, period_ns, samples = structure(1.0 / rate_Hz), round(1e9 / rate_Hz), max(1, round(seconds * rate_Hz))
    bank = CompensatorBank(s, count, hand_over_s=1.0 / optima_per_s, threads=threads)
    loop = Loop(count, rate_Hz / 2.5)
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
    return [_line(f"a bank of {count}, {threads} thread{'s' * (threads > 1)}", *ours, period_ns),
            _line("  a null step as long, the machine's floor", *floor, period_ns)]


def _line(what: str, service: Nanoseconds, response: Nanoseconds, period_ns: int) -> tuple[str, ...]:
    return (what, *tail_cells(service / 1e3, QUANTILES[:3]),
            *(f"{100.0 * float(np.mean(each > period_ns)):.3f} %" for each in (service, response)))
