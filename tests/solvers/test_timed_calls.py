"""The compiled loop that times a solver: an answer for the data of each call, and an end when its time is spent."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from programs import solver_class
from qpsolvers import Problem

import solvers
from solvers import Lane, Solver
from solvers.protocol import Matrix, Vector
from solvers.registry import Entry

KERNELS = [entry for entry in solvers.entries() if entry.lane is Lane.KERNEL and entry.times_itself]
SETTINGS: dict[str, dict[str, Any]] = {"projected_difference": {"steps": 300}}
D = 9
each_kernel = pytest.mark.parametrize("entry", KERNELS, ids=lambda entry: entry.name)


def data(count: int, seed: int = 0) -> tuple[Matrix, Matrix]:
    """Well conditioned P (n, d, d) and q (n, d), so that every solver comes to the optimum."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(count, 4 * D, D))
    return A.transpose(0, 2, 1) @ A / D, rng.normal(size=(count, D))


def optimum(P: Matrix, q: Vector) -> Vector:
    reference = solvers.get("box_active_set", "direct")
    reference.setup(Problem(P, q, lb=np.full(D, -0.1), ub=np.full(D, 0.2)))
    return reference.solve().copy()


def ready(entry: Entry, **settings: Any) -> Solver:
    cls = solver_class(entry)
    solver = cls(**{**cls.ladder(1.0)[-1], **SETTINGS.get(entry.name, {}), **settings})
    (P,), (q,) = data(1, seed=99)
    solver.setup(Problem(P, q, lb=np.full(D, -0.1), ub=np.full(D, 0.2)))
    return solver


@each_kernel
@pytest.mark.parametrize("warm", [False, True])
def test_a_loop_answers_each_of_its_data_of_any_stride_as_an_update_and_a_solve_from_python_do(
    entry: Entry, warm: bool
) -> None:
    timed, called, (P, q) = ready(entry), ready(entry), data(40)
    P.flags.writeable = q.flags.writeable = False
    P, q = P[::2], q[::-2]
    start = np.full(D, 0.2) if warm else None
    updates, solves, answers = timed.time_kernel(P, q, start)
    assert updates.shape == solves.shape == (20,)
    assert (updates >= 0).all()
    assert (solves > 0).all()
    for k, answer in enumerate(answers):
        called.update(P[k], q[k])
        np.testing.assert_array_equal(answer, called.solve(start))
        np.testing.assert_allclose(answer, optimum(P[k], q[k]), rtol=0.0, atol=1e-7)


@each_kernel
def test_no_call_begins_after_the_time_is_spent(entry: Entry) -> None:
    solver, (P, q) = ready(entry), data(400)
    updates, solves, answers = solver.time_kernel(P, q, most_ns=20_000)
    assert len(updates) == len(solves) == len(answers) < 400
    spent = np.cumsum(updates + solves)
    assert (spent[:-1] <= 20_000).all()
    assert spent[-1] > 20_000
    assert np.isfinite(answers).all()
    assert len(solver.time_kernel(P, q, most_ns=0)[0]) == 1


@each_kernel
def test_afterwards_the_solver_has_the_last_data_and_can_solve_again(entry: Entry) -> None:
    solver, (P, q) = ready(entry), data(7)
    kept = P[-1].copy(), q[-1].copy()
    *_, answers = solver.time_kernel(P, q)
    P[:], q[:] = np.nan, np.nan  # no solver keeps a pointer to them
    solution = solver.solution()
    assert solution.found
    np.testing.assert_array_equal(solution.x, answers[-1])
    np.testing.assert_allclose(solution.problem.P, kept[0], rtol=1e-14)
    np.testing.assert_allclose(solution.problem.q, kept[1], rtol=1e-14)
    np.testing.assert_allclose(solver.solve(), answers[-1], rtol=0.0, atol=1e-12)
    solver.update(q=-kept[1])
    np.testing.assert_allclose(solver.solve(), optimum(kept[0], -kept[1]), rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("name", ["box_active_set", "projected_difference", "accelerated_projection"])
def test_invalid_data_are_refused_in_the_loop_as_by_an_update(name: str) -> None:
    solver, (P, q) = ready(solvers.find(name, Lane.KERNEL)), data(3)
    P[1, 0, 0] = np.nan
    with pytest.raises(ValueError, match="must be finite"):
        solver.time_kernel(P, q)


def test_data_of_another_size_than_the_problem_set_up_are_refused() -> None:
    solver, (P, q) = ready(solvers.find("box_active_set", Lane.KERNEL)), data(3)
    with pytest.raises(ValueError, match="has not the shape"):
        solver.time_kernel(P[:, :-1, :-1], q[:, :-1])


def test_every_compiled_solver_is_here() -> None:
    files = {path.stem for path in (Path(solvers.__file__).parent / "kernel").glob("[a-z]*.py")}
    assert {entry.name for entry in KERNELS} == files
