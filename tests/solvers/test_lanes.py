"""The lanes qpsolvers and cvxpy: every solver behind them answers right, in the ecosystem's signs, and writes to
nothing.

The problems are made backwards from their answers, see ``answered_pairs``.
"""

from __future__ import annotations

import os
import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from answered_pairs import FORMS, apart_and_locked, arrays, asking, check_nothing_found, opposed_rows, pair
from qpsolvers import Problem
from scipy.sparse import csc_matrix

from solvers import Lane, Solver, Unsupported, cvxpy_lane, qpsolvers_lane
from solvers.cvxpy_lane import CvxpySolver, square_root

LANES = {Lane.QPSOLVERS: qpsolvers_lane, Lane.CVXPY: cvxpy_lane}
BEHIND = [(lane, name) for lane, module in LANES.items() for name in module.BACKENDS]
# qpsolvers has JAX trace qpax anew at every call, which takes about a second.
QUICK = [(lane, name) for lane, name in BEHIND if name != "qpax"]

# Error of x, whose entries are about 1, at a tolerance of 1e-6, about ten times what was seen over three seeds: active
# set methods end at rounding, an interior point method leaves up to √ε where a multiplier is small, and a second-order
# cone squares that.
MID = {
    "daqp": 1e-9,
    "pyqpmad": 1e-12,
    "quadprog": 1e-12,
    "highs": 1e-8,
    "osqp": 1e-4,
    "scs": 1e-4,
    "qpalm": 1e-4,
    "proxqp": 2e-4,
    "ecos": 1e-2,
    "cvxopt": 5e-3,
}
MID_OTHERS = 1e-3


def ready(lane: Lane, name: str, problem: Problem, tolerance: float | None = 1e-6) -> Solver:
    if name not in LANES[lane].installed():
        pytest.skip(f"{name} is not installed, or the lane {lane} does not find it")
    cls = LANES[lane].make(name)
    solver = cls(**asking(cls, tolerance))
    solver.setup(problem)
    return solver


def stated(name: str) -> float:
    return MID.get(name, MID_OTHERS)


@pytest.mark.parametrize("lane", LANES)
def test_a_lane_names_installed_solvers_in_lower_case_and_makes_each(lane: Lane) -> None:
    names = LANES[lane].installed()
    assert names
    for name in names:
        made = LANES[lane].make(name)
        assert name == name.lower() == made.name
        assert made.lane is lane
        assert made.algorithm
        assert made.licence


@pytest.mark.parametrize("lane", LANES)
def test_a_solver_that_is_not_there_raises_import_error_that_names_it(lane: Lane) -> None:
    with pytest.raises(ImportError, match="'no_such_solver'"):
        LANES[lane].make("no_such_solver")


def test_a_library_that_does_not_load_is_absent_in_silence(tmp_path: Path) -> None:
    (tmp_path / "proxsuite.py").write_text(
        "raise ImportError('libgomp.so.1: cannot open shared object file: No such file or directory')\n"
    )
    program = "from solvers import cvxpy_lane\nprint('proxqp' in cvxpy_lane.installed())"
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
    )
    assert (done.stdout, done.stderr) == ("False\n", "")


@pytest.mark.parametrize(
    ("lane", "name", "form"),
    [
        (*behind, form)
        for behind, form in product(BEHIND, FORMS)
        if form != "free" and (behind in QUICK or form == "rows")
    ],
)
def test_answer_and_duals_are_as_exact_as_stated(lane: Lane, name: str, form: str) -> None:
    for d in (7, 30) if name != "qpax" else (7,):
        problem = pair(form, d)
        if lane is Lane.QPSOLVERS and form == "mixed" and name in qpsolvers_lane.BREAKS_ON_INFINITY:
            with pytest.raises(Unsupported, match=name):
                ready(lane, name, problem.problems[0])
            return
        solver = ready(lane, name, problem.problems[0])
        x = solver.solve().copy()
        solution = solver.solution()
        assert solution.found, solution.extras["status"]
        assert problem.error(x) <= stated(name)
        np.testing.assert_array_equal(x, solution.x)
        scale = np.abs(problem.problems[0].q).max()
        tolerance = max(stated(name), 1e-5)
        assert solution.primal_residual() <= tolerance
        if (lane, name, form) == (Lane.QPSOLVERS, "pyqpmad", "mixed"):
            return  # qpsolvers loses the duals of variables that are fixed by lb = ub
        assert solution.dual_residual() <= tolerance * scale
        assert solution.duality_gap() <= tolerance * scale * d


@pytest.mark.parametrize(("lane", "name"), QUICK)
def test_an_update_gives_the_answer_of_a_fresh_setup(lane: Lane, name: str) -> None:
    problem = pair("one-sided", 9)
    solver = ready(lane, name, problem.problems[0])
    solver.solve()
    old, new = problem.problems
    solver.update(new.P, new.q)
    updated, fresh = solver.solve().copy(), ready(lane, name, new).solve()
    assert problem.error(updated, 1) <= stated(name)
    np.testing.assert_allclose(updated, fresh, rtol=0, atol=stated(name))
    assert solver.solution().found
    solver.update(q=old.q)
    solver.update(P=old.P)
    assert problem.error(solver.solve()) <= stated(name)


@pytest.mark.parametrize(("lane", "name"), QUICK)
def test_arrays_handed_in_are_read_at_any_stride_and_never_written(lane: Lane, name: str) -> None:
    problem = pair("rows", 8)
    first, second = ({key: apart_and_locked(value) for key, value in arrays(p).items()} for p in problem.problems)
    solver = ready(lane, name, Problem(**first))
    solver.solve()
    solver.update(second["P"], second["q"])
    assert problem.error(solver.solve(), 1) <= stated(name)
    again = solver.solve().copy()  # a backend that wrote to our copies would now answer another problem
    assert problem.error(again, 1) <= stated(name)
    solver.solution()
    for given, kept in zip((first, second), problem.problems, strict=True):
        for key, value in given.items():
            np.testing.assert_array_equal(value, getattr(kept, key))


@pytest.mark.parametrize(("lane", "name"), QUICK)
def test_a_sparse_problem_has_the_answer_of_the_dense_one(lane: Lane, name: str) -> None:
    problem = pair("rows", 7)
    p = problem.problems[0]
    sparse = Problem(csc_matrix(p.P), p.q, csc_matrix(p.G), p.h, csc_matrix(p.A), p.b, p.lb, p.ub)
    assert problem.error(ready(lane, name, sparse).solve()) <= stated(name)


@pytest.mark.filterwarnings("ignore::UserWarning")  # qpsolvers and cvxpy say it in a warning too
@pytest.mark.parametrize(("lane", "name"), BEHIND)
def test_an_infeasible_problem_is_never_called_found(lane: Lane, name: str) -> None:
    check_nothing_found(ready(lane, name, opposed_rows()))


@pytest.mark.parametrize(("lane", "name"), QUICK)
def test_a_start_keeps_the_answer_and_is_used_where_the_class_says_so(lane: Lane, name: str) -> None:
    problem = pair("boxes", 12)
    solver = ready(lane, name, problem.problems[0])
    cold, start = solver.solve().copy(), problem.answers[0]
    warm = solver.solve(warm_start=start).copy()
    assert problem.error(warm) <= stated(name)
    assert problem.error(solver.solve()) <= stated(name)
    if solver.warm_startable:
        assert not np.array_equal(warm, cold)


def test_qpsolvers_refuses_what_it_would_hand_to_scipy() -> None:
    for name in qpsolvers_lane.HANDED_TO_SCIPY & set(qpsolvers_lane.installed()):
        with pytest.raises(Unsupported, match=name):
            ready(Lane.QPSOLVERS, name, Problem(np.eye(2), np.ones(2)))


def test_cvxpy_compiles_the_problem_once_since_it_is_dpp() -> None:
    problem = pair("rows", 6)
    solver = ready(Lane.CVXPY, "clarabel", problem.problems[0])
    assert isinstance(solver, CvxpySolver)
    assert solver.model.is_dcp(dpp=True)
    compiled = solver.model._cache.param_prog
    assert compiled is not None
    solver.solve()
    solver.update(problem.problems[1].P, problem.problems[1].q)
    assert problem.error(solver.solve(), 1) <= stated("clarabel")
    assert solver.model._cache.param_prog is compiled


def test_the_square_root_of_a_singular_cost_still_gives_that_cost() -> None:
    M = np.random.default_rng(0).normal(size=(3, 6))
    root = square_root(M.T @ M)
    np.testing.assert_allclose(root.T @ root, M.T @ M, atol=1e-12)


def test_an_indefinite_cost_is_refused_by_cvxpy_with_its_eigenvalue() -> None:
    with pytest.raises(Unsupported, match="-2"):
        ready(Lane.CVXPY, "clarabel", Problem(np.diag([1.0, -2.0]), np.zeros(2), lb=np.zeros(2)))
