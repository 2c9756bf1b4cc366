"""The worst of a million consecutive samples of the recursive solver in compiled code, beside a step that does nothing.

The rows of a stream over a drifting actuator (:mod:`bench.races.stream.stream_problem`) are taken back to back, there and back again,
with a clock round each. A machine that is no real-time system stops any loop for milliseconds now and then, in proportion to the
time that the loop runs. So the null step lasts as long as the solver's median step, waiting for the clock and doing nothing
else: what it takes longer is the machine's floor, over the same time.
"""

from __future__ import annotations

import numpy as np

import solvers
from bench.problems.drift import DRIFT_PER_S, TIME_CONSTANT_S
from bench.problems.simulation import Experiment
from bench.races.stream.stream_problem import make
from bench.timing.percentiles import tail_cells
from bench.timing.schedule import PERIOD_NS
from solvers.arrays import Nanoseconds
from solvers.core import face

SAMPLES = 1_000_000
STREAM = 4_000
"""Rows of the stream, which is gone along there and back."""
ORDERS = ((5, 3), (20, 9))
"""(n, m) of the models, for d = 18 and 60."""
HEADINGS = ("a million samples, ns", "p50", "p99", "p99.9", "p99.99", "max", "above 125 µs")


def solver_steps(n: int, m: int, samples: int) -> tuple[int, Nanoseconds]:
    """Number of unknowns d, and nanoseconds of each step of the recursive solver, shape (samples,)."""
    stream = make(Experiment("relay_preisach", "random_walk", n, m, drift_per_s=DRIFT_PER_S), STREAM, TIME_CONSTANT_S, 0)
    solver = solvers.get("recursive_active_set", "kernel", forgetting=stream.forgetting)
    solver.setup(stream.start)
    ways = stream.rows, np.ascontiguousarray(stream.rows[::-1])
    solver.time_rows(ways[0], stream.forgetting)
    solver.time_rows(ways[1], stream.forgetting)
    taken = [solver.time_rows(ways[i % 2], stream.forgetting)[1] for i in range(-(-samples // STREAM))]
    return stream.d, np.concatenate(taken)[:samples]


def line(what: str, nanoseconds: Nanoseconds) -> tuple[str, ...]:
    """One row of the table: order statistics, and how many missed the sampling period."""
    return what, *tail_cells(nanoseconds), str(int((nanoseconds > PERIOD_NS).sum()))


def worst_case_figures(samples: int = SAMPLES) -> list[tuple[str, ...]]:
    """The table, for d = 18 and 60."""
    table = []
    for n, m in ORDERS:
        d, taken = solver_steps(n, m, samples)
        floor = np.zeros(samples, dtype=np.int64)
        face.time_nothing(int(np.median(taken)), floor)
        table += [line(f"recursive solver, d = {d}", taken), line("  a null step as long, the machine's floor", floor)]
    return table
