"""The hot kernels beside vectorised NumPy: ``make perf``.

Each figure is the fastest of several runs on one core, in nanoseconds a sample or a step. NumPy's version is the same
arithmetic written with whole-array operations wherever the recursion over time allows it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from time import perf_counter_ns

import numpy as np
from numpy.typing import NDArray

from bench.cli.console import console, print_table
from piezo_model import DataBasis, ModelStructure, OperatorState
from piezo_model.signals import multi_sine

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

SAMPLES = 64_000


def fastest(call: Callable[[], object], count: int, repeats: int = 25) -> float:
    """Nanoseconds of one of the ``count`` things that a call does, in the fastest of several calls."""
    call()
    times = []
    for _ in range(repeats):
        start = perf_counter_ns()
        call()
        times.append(perf_counter_ns() - start)
    return min(times) / count


def numpy_data_basis(s: ModelStructure, x: Vector, y: Vector) -> Matrix:
    """Gram matrix of (x, Ξ): vectors over the operators at every sample, one matrix product at the end."""
    r = np.array((0.0, *s.play_thresholds))
    r_S = np.array(s.dead_zone_thresholds)
    a = -np.expm1(-np.array(s.creep_rates) * s.sample_time)[:, None]
    play, creep = np.zeros(r.size), np.zeros((a.size, r.size))
    plays, creeps = np.empty((x.size, r.size)), np.empty((x.size, r.size))
    for k in range(x.size):
        play = np.maximum(x[k] - r, np.minimum(x[k] + r, play))
        plays[k], creeps[k] = play, creep.sum(axis=0)
        creep = creep + a * (np.maximum(x[k] - r, np.minimum(x[k] + r, creep)) - creep)
    zones = np.where(r_S > 0, np.maximum(y[:, None] - r_S, 0), np.where(r_S < 0, np.minimum(y[:, None] - r_S, 0),
                                                                         y[:, None]))
    rows = np.concatenate([plays, -zones, creeps], axis=1)
    gram: Matrix = rows.T @ rows
    return gram


def data_basis_figures() -> list[tuple[str, str, str, str]]:
    """Data basis at d = 18 with three creep rates."""
    s = ModelStructure.equidistant(5, 3, (0.0, 150.0), (-20.0, 20.0), (10.0, 1.0, 0.1), 125e-6)
    x = multi_sine(duration_s=SAMPLES * 125e-6, sample_time=125e-6, low=0.0, high=150.0)
    y = (x - 75.0) / 4.0 + 0.5 * np.sin(x / 10.0)
    basis, moving = DataBasis(s), DataBasis(s)
    ours = fastest(lambda: basis.update(x, y), SAMPLES)
    states = fastest(lambda: moving.update(x, y, count=False), SAMPLES)
    unit_x, unit_y = s.unit_input(x), s.unit_output(y)
    theirs = fastest(lambda: numpy_data_basis(s, unit_x, unit_y), SAMPLES, repeats=2)
    check = DataBasis(s, OperatorState.at_rest(s))
    check.update(x, y)
    dense = numpy_data_basis(s, unit_x, unit_y)[1:, 1:] / SAMPLES
    if not np.allclose(check.P, dense, rtol=1e-9, atol=1e-12):
        raise AssertionError("the two data bases differ, so the figures would compare different things")
    return [_figure("data basis, d = 18, 3 creep rates, a sample", ours, theirs),
            _figure("  of it, moving the operator states on", states, None)]


def _figure(what: str, ours: float, theirs: float | None) -> tuple[str, str, str, str]:
    return (what, f"{ours:.1f}", "" if theirs is None else f"{theirs:.0f}",
            "" if theirs is None else f"{theirs / ours:.0f}")


def main() -> None:
    """Measure and print."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    print_table(("what", "ours, ns", "NumPy, ns", "ratio"), data_basis_figures())
    console.print("Fastest of several runs on one core; compare ratios.")


if __name__ == "__main__":
    main()
