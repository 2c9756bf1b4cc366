"""The hot kernels beside vectorised NumPy: ``piezobench perf``.

Each figure is the fastest of several runs on one core, in nanoseconds a sample or a step. NumPy's version is the same
arithmetic written with whole-array operations wherever the recursion over time allows it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from time import perf_counter_ns
from typing import Literal

import numpy as np
from qpsolvers import Problem

import solvers
from bench.bank_figures import (
    COST_HEADINGS,
    STEP_HEADINGS,
    cost_by_count,
    steps_in_real_time,
    structure,
    where_memory_takes_over,
)
from bench.problems import find
from bench.report.console import console, print_table
from bench.worst_case import HEADINGS, worst_case_figures
from piezo_model import (
    Compensator,
    DataBasis,
    ModelStructure,
    OperatorState,
    SelfLearningCompensator,
    plants,
)
from piezo_model.learning.events import Phase
from piezo_model.learning.layout import PROXIMAL
from piezo_model.learning.sensor_guard import SensorGuard
from piezo_model.learning.settings import MIN_SLOPE
from piezo_model.operators import creep, dead_zone, play
from piezo_model.signals import multi_sine
from solvers.arrays import Matrix, Vector
from solvers.core import BUILT_WITH
from solvers.descent import limit
from solvers.kernel.recursive_active_set import RecursiveActiveSet

SAMPLES = 64_000
SHORT = 4_000
"""Samples of a loop that are timed at once: few, so that on a busy machine some run is left in peace."""


def fastest(call: Callable[[], object], count: int, repeats: int = 25, prepare: Callable[[], object] | None = None) -> float:
    """Nanoseconds of one of the ``count`` things that a call does, in the fastest of several calls, each one prepared."""
    call()
    times = []
    for _ in range(repeats):
        if prepare is not None:
            prepare()
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
    s = structure(125e-6)
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


def projected_step_figures() -> list[tuple[str, str, str, str]]:
    """One step of the paper's difference equation at d = 18, beside NumPy."""
    steps = 10_000
    problem = next(find("paper")().problems()).forms["scaled"].qp
    P, q, lb = problem.P, problem.q, problem.lb
    solver = solvers.get("projected_difference", steps=steps)
    solver.setup(problem)
    less = np.linspace(0.9, 1.0, 50)  # of P, so that all are other data
    ours = min(solver.time_kernel(less[:, None, None] * P, less[:, None] * q)[1]) / steps
    eta = 0.5 * limit(P)
    theirs = fastest(lambda: numpy_steps(P, q, lb, eta, 1000), 1000, repeats=5)
    if not np.allclose(solver.solve(), numpy_steps(P, q, lb, eta, steps), rtol=1e-9, atol=1e-12):
        raise AssertionError("the two iterations differ, so the figures would compare different things")
    return [_figure("projected step, d = 18", ours, theirs)]


def learning_loop_figures() -> list[tuple[str, str, str, str]]:
    """The whole self-learning loop a sample at d = 18 with three creep rates, and its parts alone."""
    plant = plants.Sensor(plants.get("relay_preisach"), noise_um=0.008)
    s = ModelStructure.equidistant(5, 3, plant.x_range, plant.y_range, (10.0, 1.0, 0.1), plant.sample_time)
    state = OperatorState.at_rest(s, -1.0, 1.0)
    y_ref = multi_sine(duration_s=SAMPLES * s.sample_time, sample_time=s.sample_time, low=-16.0, high=16.0)

    def learner(solver: str, mode: Literal["cyclic", "continuous"], build_s: float) -> SelfLearningCompensator:
        return SelfLearningCompensator(s, 0.1, build_s, 100.0, solver, mode=mode, state=state, samples_to_solve=1,
                                       find_centre=False)

    x, y = learner("projected_difference", "cyclic", 100.0).run(y_ref, plant.run)
    before = np.concatenate([[np.nan], y[:-1]])

    def loop(solver: str, mode: Literal["cyclic", "continuous"], build_s: float, phase: Phase) -> float:
        """Nanoseconds a sample of a whole loop that stays in one phase."""
        one, part = learner(solver, mode, build_s), slice(20_000, 20_000 + SHORT)
        one.replay(y_ref[:part.start], before[:part.start])
        if one.phase is not phase:
            raise AssertionError(f"the loop is in phase {one.phase} and not in {phase}")
        memory = one.memory()
        return fastest(lambda: one.replay(y_ref[part], before[part]), SHORT, 400, lambda: one.restore(memory))

    compensator = Compensator(learner("box_active_set", "cyclic", 8.0).model, plant.x_range)
    guard, moving = SensorGuard(), DataBasis(s)
    unit_x, unit_y = s.unit_input(x), s.unit_output(y)
    solver = RecursiveActiveSet(forgetting=math.exp(-s.sample_time / 2.0), proximal=PROXIMAL)
    solver.setup(Problem(1e-6 * np.eye(s.d), np.zeros(s.d), lb=s.lower_bounds(MIN_SLOPE), ub=np.full(s.d, np.inf)))
    rows = recursive_rows(s, x, y)
    return [_figure("whole loop while it builds", loop("projected_difference", "cyclic", 100.0, Phase.BUILD), None),
            _figure("whole loop while it learns, a projected step", loop("projected_difference", "cyclic", 1.0, Phase.LEARN), None),
            _figure("whole loop, recursive solver, hand-overs", loop("box_active_set", "continuous", 8.0, Phase.LEARN), None),
            _figure("  of it, compensation", fastest(lambda: compensator.run(y_ref[:SHORT]), SHORT, 400), None),
            _figure("  of it, the guard", fastest(lambda: guard.judge(unit_x, unit_y), SAMPLES), None),
            _figure("  of it, states of the learner", fastest(lambda: moving.update(x, y, count=False), SAMPLES), None),
            _figure("  of it, the recursive solver", fastest(lambda: solver.append_many(rows[:SHORT]), SHORT, 400), None)]


def recursive_rows(s: ModelStructure, x: Vector, y: Vector) -> Matrix:
    """Rows (Ξ, x) of samples, (N, d + 1), in slope coordinates."""
    r, r_S, T = np.array((0.0, *s.play_thresholds)), np.array(s.dead_zone_thresholds), s.slope_map
    x, y = s.unit_input(x), s.unit_output(y)
    plays, creeps = play(x, r, -1.0 + r)[0], np.zeros((x.size, r.size))
    for rate in s.creep_rates:
        creeps += creep(x, r, np.full(r.size, rate), s.sample_time, -1.0 + r)[0]
    rows: Matrix = np.column_stack([np.column_stack([plays[:, 1:], -dead_zone(y, r_S), creeps]) @ T, x])
    return rows


def numpy_steps(P: Matrix, q: Vector, lb: Vector, eta: float, steps: int) -> Vector:
    """The same with whole-array operations."""
    w = np.maximum(np.zeros(q.size), lb)
    for _ in range(steps):
        w = np.maximum(w - eta * (P @ w + q), lb)
    return w


def _figure(what: str, ours: float, theirs: float | None) -> tuple[str, str, str, str]:
    return (what, f"{ours:.1f}", "" if theirs is None else f"{theirs:.0f}",
            "" if theirs is None else f"{theirs / ours:.0f}")


def show() -> None:
    """Measure and print."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    print_table(("what", "ours, ns", "NumPy, ns", "ratio"),
                [*data_basis_figures(), *projected_step_figures(), *learning_loop_figures()])
    console.print(f"Fastest of several runs on one core; compare ratios. {BUILT_WITH}.")
    print_table(HEADINGS, worst_case_figures())
    costs = cost_by_count()
    print_table(COST_HEADINGS, costs)
    console.print(where_memory_takes_over(costs))


def show_bank(count: int, rate_Hz: float, seconds: float, threads: int, optima_per_s: float) -> None:
    """Step a bank in real time and print the distribution."""
    print_table(STEP_HEADINGS, steps_in_real_time(count, rate_Hz, seconds, threads, optima_per_s))
    console.print(f"Period {1e6 / rate_Hz:.0f} µs, {optima_per_s:g} exact optima a second of each, {seconds:g} s each; {BUILT_WITH}.")
