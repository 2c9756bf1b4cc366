"""The slowest of a million consecutive samples of the recursive solver: ``python tests/benchmarks/worst_case.py
[SAMPLES]``.

The rows of a stream over a drifting actuator (:mod:`bench.races.stream.stream_problem`) are taken back to back,
forwards and backwards in turn, with a clock round each. A machine that is no real-time system stops any loop for
milliseconds now and then, in proportion to the time that the loop runs. So a null step that waits for the solver's
median time and does nothing else stands beside it: what that takes longer is the machine's floor.
"""

import sys

import numpy as np

import solvers
from bench.problems.drift import DRIFT_PER_S, TIME_CONSTANT_S
from bench.problems.simulation import Experiment
from bench.races.stream.stream_problem import make
from bench.report.console import print_table
from bench.timing.percentiles import tail_cells
from bench.timing.schedule import PERIOD_NS
from solvers.arrays import Nanoseconds
from solvers.core import bindings

SAMPLES = 1_000_000
STREAM = 4_000
"""Rows of the stream."""
ORDERS = ((5, 3), (20, 9))
"""(n, m) of the models, for d = 18 and 60."""


def solver_steps(n: int, m: int, samples: int) -> tuple[int, Nanoseconds]:
    """Number of unknowns d, and nanoseconds of each step of the recursive solver, shape (samples,)."""
    stream = make(
        Experiment("relay_preisach", "random_walk", n, m, drift_per_s=DRIFT_PER_S), STREAM, TIME_CONSTANT_S, 0
    )
    solver = solvers.get("recursive_active_set", "kernel", forgetting=stream.forgetting)
    solver.setup(stream.start)
    both = stream.rows, np.ascontiguousarray(stream.rows[::-1])
    taken = [solver.time_rows(both[i % 2], stream.forgetting)[1] for i in range(2 + -(-samples // STREAM))]
    return stream.d, np.concatenate(taken[2:])[:samples]  # the first two warm up


def main(samples: int = SAMPLES) -> None:
    """Measure and print."""
    rows = []
    for n, m in ORDERS:
        d, taken = solver_steps(n, m, samples)
        floor = np.zeros(samples, dtype=np.int64)
        bindings.time_nothing(int(np.median(taken)), floor)
        rows += [
            (what, *tail_cells(ns), str(int((ns > PERIOD_NS).sum())))
            for what, ns in (
                (f"recursive solver, d = {d}", taken),
                ("  a null step as long, the machine's floor", floor),
            )
        ]
    print_table(
        (f"{samples} samples, ns", "p50", "p99", "p99.9", "p99.99", "max", f"above {PERIOD_NS // 1000} µs"), rows
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
