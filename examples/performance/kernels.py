"""The hot kernels beside vectorised NumPy, in nanoseconds a sample or a step: ``python examples/performance/kernels.py
[REPEATS]``.

Each figure is the fastest of several runs on one core: compare ratios. NumPy's version is the same arithmetic with
whole-array operations wherever the recursion over time allows it. PIEZOBENCH_ISA=v3 in the environment asks for AVX2
where there is AVX-512.
"""

import sys
from collections.abc import Callable
from time import perf_counter_ns
from typing import Any

import numpy as np

import solvers
from bench.problems import find
from bench.report.console import console, print_table
from bench.timing import cores
from piezo_model import Compensator, DataBasis, ModelStructure, OperatorState, SelfLearningCompensator, plants
from piezo_model.signals import multi_sine
from solvers.arrays import Matrix, Vector
from solvers.core import BUILT_WITH

SAMPLES = 64_000
SHORT = 4_000
"""Samples of a loop that are timed at once: few, so that on a busy machine some run is left in peace."""
REPEATS = 25
Row = tuple[str, float, float | None]
"""What is timed, and ns of it by the core and by NumPy."""


def fastest(
    call: Callable[[], object], count: int, repeats: int, prepare: Callable[[], object] = lambda: None
) -> float:
    """Nanoseconds of one of the ``count`` things that a call does, in the fastest of several calls, each one
    prepared."""
    call()
    times = []
    for _ in range(repeats):
        prepare()
        start = perf_counter_ns()
        call()
        times.append(perf_counter_ns() - start)
    return min(times) / count


def data_basis(repeats: int) -> list[Row]:
    """Data basis at d = 18 with three creep rates."""
    s = ModelStructure.equidistant(5, 3, (0.0, 150.0), (-20.0, 20.0), (10.0, 1.0, 0.1), 125e-6)
    x = multi_sine(duration_s=SAMPLES * s.sample_time, sample_time=s.sample_time, low=0.0, high=150.0)
    y = (x - 75.0) / 4.0 + 0.5 * np.sin(x / 10.0)
    basis, moving, check = DataBasis(s), DataBasis(s), DataBasis(s, OperatorState.settled_at(s, s.x_centre))
    unit_x, unit_y = s.unit_input(x), s.unit_output(y)
    check.update(x, y)
    np.testing.assert_allclose(check.P, numpy_gram_matrix(s, unit_x, unit_y)[1:, 1:] / SAMPLES, rtol=1e-9, atol=1e-12)
    return [
        (
            "data basis, d = 18, 3 creep rates, a sample",
            fastest(lambda: basis.update(x, y), SAMPLES, repeats),
            fastest(lambda: numpy_gram_matrix(s, unit_x, unit_y), SAMPLES, 2),
        ),
        (
            "  of it, moving the operator states on",
            fastest(lambda: moving.update(x, y, count=False), SAMPLES, repeats),
            None,
        ),
    ]


def numpy_gram_matrix(s: ModelStructure, x: Vector, y: Vector) -> Matrix:
    """Gram matrix of (x, Ξ): vectors over the operators at every sample, one matrix product at the end."""
    r, r_S = np.array((0.0, *s.play_thresholds)), np.array(s.dead_zone_thresholds)
    a = -np.expm1(-np.array(s.creep_rates) * s.sample_time)[:, None]
    play, creep = np.zeros(r.size), np.zeros((a.size, r.size))
    plays, creeps = np.empty((x.size, r.size)), np.empty((x.size, r.size))
    for k in range(x.size):
        play = np.maximum(x[k] - r, np.minimum(x[k] + r, play))
        plays[k], creeps[k] = play, creep.sum(axis=0)
        creep = creep + a * (np.maximum(x[k] - r, np.minimum(x[k] + r, creep)) - creep)
    u = y[:, None]
    zones = np.where(r_S > 0, np.maximum(u - r_S, 0), np.where(r_S < 0, np.minimum(u - r_S, 0), u))
    rows = np.concatenate([plays, -zones, creeps], axis=1)
    gram: Matrix = rows.T @ rows
    return gram


def projected_step(repeats: int) -> list[Row]:
    """One step of the paper's difference equation at d = 18."""
    steps, problem = 10_000, next(find("paper")().problems()).forms["scaled"].qp
    P, q, lb = problem.P, problem.q, problem.lb
    solver = solvers.get("projected_difference", steps=steps)
    solver.setup(problem)
    less = np.linspace(0.9, 1.0, 2 * repeats)  # of P, so that all are other data
    ours = min(solver.time_kernel(less[:, None, None] * P, less[:, None] * q)[1]) / steps

    def numpy_steps(count: int) -> Vector:
        w, eta = np.maximum(np.zeros(q.size), lb), solver.solution().extras["eta"]
        for _ in range(count):
            w = np.maximum(w - eta * (P @ w + q), lb)
        return w

    answer = solver.solve()
    np.testing.assert_allclose(answer, numpy_steps(steps), rtol=1e-9, atol=1e-12)
    return [("projected step, d = 18", ours, fastest(lambda: numpy_steps(1000), 1000, 5))]


def learning_loop(repeats: int) -> list[Row]:
    """The whole self-learning loop a sample at d = 18 with three creep rates, and its parts alone."""
    plant = plants.Sensor(plants.get("relay_preisach"), noise_um=0.008)
    s = ModelStructure.equidistant(5, 3, plant.x_range, plant.y_range, (10.0, 1.0, 0.1), plant.sample_time)
    y_ref = multi_sine(duration_s=SAMPLES * s.sample_time, sample_time=s.sample_time, low=-16.0, high=16.0)

    def learner(**options: Any) -> SelfLearningCompensator:
        return SelfLearningCompensator(
            s,
            0.1,
            learn_s=100.0,
            state=OperatorState.settled_at(s, s.x_range[0], came_from="above"),
            solve_delay_samples=1,
            estimate_offset=False,
            **options,
        )

    y = learner(build_s=100.0, solver="projected_difference").run(y_ref, plant.run)[1]
    before, part = np.concatenate([[np.nan], y[:-1]]), slice(20_000, 20_000 + SHORT)

    def loop(phase: str, **options: Any) -> Row:
        """A loop that stays in one phase."""
        one = learner(**options)
        one.replay(y_ref[: part.start], before[: part.start])
        if one.phase != phase:
            raise AssertionError(f"the loop is in phase {one.phase} and not in {phase}")
        memory = one.get_state()
        return (
            f"whole loop, {', '.join(map(str, options.values()))}: {phase}",
            fastest(lambda: one.replay(y_ref[part], before[part]), SHORT, 16 * repeats, lambda: one.restore(memory)),
            None,
        )

    compensator = Compensator(learner(solver="box_active_set").model, plant.x_range)
    return [
        loop("build", solver="projected_difference", build_s=100.0),
        loop("learn", solver="projected_difference", build_s=1.0),
        loop("learn", solver="box_active_set", mode="continuous"),
        ("  of it, compensation", fastest(lambda: compensator.run(y_ref[:SHORT]), SHORT, 16 * repeats), None),
    ]


def main(repeats: int = REPEATS) -> None:
    """Measure and print."""
    with cores.claim() as core, core.pinned():
        rows = [*data_basis(repeats), *projected_step(repeats), *learning_loop(repeats)]
    print_table(
        ("what", "ours, ns", "NumPy, ns", "ratio"),
        [
            (what, f"{ours:.1f}", *(("", "") if theirs is None else (f"{theirs:.0f}", f"{theirs / ours:.0f}")))
            for what, ours, theirs in rows
        ],
    )
    console.print(f"Fastest of several runs on one core; compare ratios. {BUILT_WITH}.")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
