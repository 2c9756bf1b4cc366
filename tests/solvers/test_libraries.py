"""Every library in every lane of Python: accuracy of the answers, statuses, and inputs that are not written to.

The problems are constructed from their answers, see ``answered_pairs``.
"""

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answered_pairs import FORMS, arrays, asking, pair, strided_and_locked
from command_line import python
from programs import COMMERCIAL, solver_class
from scipy.sparse import csc_matrix, csr_matrix, issparse

import solvers
from solvers import Lane, Problem, Unsupported, cvxpy_lane, qpsolvers_lane
from solvers.cvxpy_lane import square_root
from solvers.registry import FAMILIES, OURS


@dataclass(frozen=True)
class Stated:
    """Requirements on a solver: the forms that it takes, and the largest error of x at tolerances of 1e-6 and 1e-9."""

    mid: float
    high: float = 0.0
    forms: tuple[str, ...] = FORMS
    warm: bool = False
    """Whether a start helps."""
    gives_up: bool = False
    """Whether the library may report at 1e-9 that it found no answer."""


# Errors of x, whose entries are about 1, about ten times the largest over eight seeds.
# An interior point method that stops at a gap ε leaves up to √ε where a multiplier is small, a second-order cone
# squares that; active set methods end at rounding.
DIRECT = {
    "casadi_qpoases": Stated(1e-12, 1e-12),
    "clarabel": Stated(1e-3, 1e-3),
    "cvxopt": Stated(5e-4, 1e-6),
    "daqp": Stated(1e-9, 1e-11, warm=True),
    "highspy": Stated(1e-2, 2e-5),
    "osqp": Stated(1e-3, 1e-5, warm=True),
    "piqp": Stated(1e-3, 1e-3),
    "proxsuite": Stated(1e-3, 1e-5, warm=True),
    "pyqpmad": Stated(1e-11, 1e-11),
    "qoco": Stated(5e-4, 1e-6),
    "qpalm": Stated(5e-5, 1e-7, warm=True),
    "qtqp": Stated(2e-3, 1e-6, ("boxes", "one-sided", "mixed", "rows")),
    "quadprog": Stated(1e-11, 1e-11),
    "scipy_bvls": Stated(1e-12, 1e-12, ("boxes", "one-sided", "free")),
    "scipy_lbfgsb": Stated(2e-5, 2e-6, ("boxes", "one-sided", "mixed", "free", "fixed"), gives_up=True, warm=True),
    "scipy_nnls": Stated(1e-12, 1e-12, ("one-sided",)),
    "scs": Stated(1e-3, 1e-5, warm=True),
}
BEHIND = {
    "daqp": Stated(1e-9),
    "pyqpmad": Stated(1e-12),
    "quadprog": Stated(1e-12),
    "highs": Stated(1e-8),
    "osqp": Stated(1e-4),
    "scs": Stated(1e-4),
    "qpalm": Stated(1e-4),
    "proxqp": Stated(2e-4),
    "ecos": Stated(1e-2),
    "cvxopt": Stated(5e-3),
}
LANES = {Lane.QPSOLVERS: qpsolvers_lane, Lane.CVXPY: cvxpy_lane}
SPREAD = (
    "clarabel",
    "daqp",
    "highspy",
    "osqp",
    "piqp",
    "proxsuite",
    "pyqpmad",
    "quadprog",
    "scs",
)
"""Solvers that are also tested with variables of very different size."""
COMPILED = ("daqp", "quadprog")
UNCOUNTED = ("scipy_nnls",)

LIMIT = {
    **dict.fromkeys(("clarabel", "osqp", "piqp", "proxqp", "proxsuite", "pyqpmad", "qpalm", "qtqp"), "max_iter"),
    **dict.fromkeys(("qoco", "scs", "ecos"), "max_iters"),
    "cvxopt": "maxiters",
    "daqp": "iter_limit",
    "scipy_bvls": "max_iter",
    "scipy_lbfgsb": "maxiter",
}
"""Setting for the number of iterations of libraries that return the last iterate when they reach it."""
SILENT = [(Lane.QPSOLVERS, "daqp"), (Lane.QPSOLVERS, "pyqpmad"), (Lane.CVXPY, "cvxopt"), (Lane.CVXPY, "daqp")]
"""Of these, the package passes no answer on, or none with multipliers, when the library did not find it."""


def stated(lane: Lane, name: str) -> Stated:
    return DIRECT[name] if lane is Lane.DIRECT else BEHIND.get(name, Stated(1e-3))


ALL: list[tuple[Lane, str]] = [
    *((Lane.DIRECT, name) for name in DIRECT),
    *((lane, name) for lane, names in FAMILIES.items() for name in names),
]
QUICK = [case for case in ALL if case[1] != "qpax"]
"""qpsolvers has JAX trace qpax anew at every call, which takes about a second."""
BREAKS = [(Lane.QPSOLVERS, name, "mixed") for name in sorted(qpsolvers_lane.BREAKS_ON_INFINITY)]
"""The package passes infinite bounds on to these, which do not take them."""
TAKEN = [
    (*case, form)
    for case in ALL
    for form in stated(*case).forms
    if (case[0] is Lane.DIRECT or case in QUICK or form == "rows") and (*case, form) not in BREAKS
]


def parts(cases: Iterable[tuple[Any, ...]]) -> list[Any]:
    """Parameters; those of qpax, which compiles for seconds, are slow."""
    return [pytest.param(*case, marks=[pytest.mark.slow] * ("qpax" in case)) for case in cases]


each_solver = pytest.mark.parametrize(
    ("lane", "name"), [*parts(QUICK), *((entry.lane, entry.name) for entry in solvers.entries() if entry.times_itself)]
)
each_common = pytest.mark.parametrize("name", SPREAD)


def sizes(lane: Lane, name: str, form: str) -> tuple[int, ...]:
    if name == "qpax":
        return (7,)  # it compiles for each size
    return (1, 2, 7, 30) if form in ("boxes", "one-sided") else (7, 30)


def ready(lane: Lane, name: str, problem: Problem, tolerance: float | None = 1e-6, **settings: Any) -> Any:
    cls = solver_class(solvers.find(name, lane))
    solver = cls(**{**asking(cls, tolerance), **settings})
    solver.setup(problem)
    return solver


def richest(lane: Lane, name: str) -> str:
    """The form with rows, or the one that every solver takes."""
    return "rows" if (lane, name, "rows") in TAKEN or (lane is Lane.KERNEL and name in COMPILED) else "one-sided"


@pytest.mark.parametrize(("lane", "name", "form"), parts(TAKEN))
def test_the_answer_and_its_duals_are_as_exact_as_stated(lane: Lane, name: str, form: str) -> None:
    error = stated(lane, name).mid
    for d in sizes(lane, name, form):
        problem = pair(form, d, seed=6 * (d == 1))  # then an answer is at a bound
        given = problem.problems[0]
        solver = ready(lane, name, given)
        x, solution = solver.solve().copy(), solver.solution()
        assert solution.found, solution.extras["status"]
        assert problem.error(x) <= error
        np.testing.assert_array_equal(x, solution.x)
        extras = solution.extras
        if lane is Lane.DIRECT:
            assert set(extras) == {"status", "reported_us", "iterations"}
            assert isinstance(extras["status"], str)
            assert extras["iterations"] is None if name in UNCOUNTED else extras["iterations"] >= 0
            assert extras["reported_us"] is None or 0 < extras["reported_us"] < 1e8
        assert solution.obj == pytest.approx(0.5 * x @ given.P @ x + given.q @ x)
        tolerance, scale = max(error, 1e-5), np.abs(given.q).max()
        assert solution.primal_residual() <= tolerance
        if (lane, name, form) == (Lane.QPSOLVERS, "pyqpmad", "mixed"):
            return  # qpsolvers loses the duals of variables that are fixed by lb = ub
        assert solution.dual_residual() <= tolerance * scale
        assert solution.duality_gap() <= tolerance * scale * d
        signs = solution.z_box[np.isinf(given.lb)], -solution.z_box[np.isinf(given.ub)], solution.z
        assert (np.concatenate(signs) > -1e-6 * scale - tolerance).all()


@pytest.mark.parametrize(
    ("name", "form"),
    parts(
        [
            *((name, form) for lane, name, form in TAKEN if lane is Lane.DIRECT),
            *product(SPREAD, ("mixed rows", "free rows")),
        ]
    ),
)
def test_an_answer_found_at_a_tight_tolerance_is_as_exact_as_stated(name: str, form: str) -> None:
    for d, decades in product(sizes(Lane.DIRECT, name, form)[-2:], (0.0, 4.0) if name in SPREAD else (0.0,)):
        problem = pair(form, d, seed=1, decades=decades)
        solver = ready(Lane.DIRECT, name, problem.problems[0], 1e-9)
        assert problem.error(solver.solve()) <= DIRECT[name].high
        assert solver.solution().found or DIRECT[name].gives_up


INDEFINITE = Problem(np.diag([1.0, -2.0]), np.zeros(2), lb=np.zeros(2))
NOT_TAKEN = [
    *((Lane.DIRECT, name, form) for name, form in product(DIRECT, FORMS) if form not in DIRECT[name].forms),
    *(case for case in BREAKS if case[:2] in ALL),
]


@pytest.mark.parametrize(
    ("lane", "name", "problem", "said"),
    [
        *(
            pytest.param(lane, name, pair(form, 12).problems[0], name, id=f"{lane}-{name}-{form}")
            for lane, name, form in NOT_TAKEN
        ),
        pytest.param(Lane.CVXPY, "clarabel", INDEFINITE, "-2", id="cvxpy-clarabel-indefinite"),
        pytest.param(Lane.DIRECT, "osqp", INDEFINITE, "error 4", id="direct-osqp-indefinite"),
    ],
)
def test_a_form_that_a_solver_cannot_take_is_refused_by_its_name_and_an_indefinite_cost_with_what_shows_it(
    lane: Lane, name: str, problem: Problem, said: str
) -> None:
    with pytest.raises(Unsupported, match=said):
        ready(lane, name, problem)


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("name", parts((name,) for name in DIRECT))
def test_exact_zeros_of_P_may_appear_and_vanish(name: str, sparse: bool) -> None:
    d, given = 6, pair("one-sided", 6).problems[0]
    blocks = given.P * (np.add.outer(np.arange(d), np.arange(d)) % 2 == 0)
    solver = ready(Lane.DIRECT, name, Problem(csc_matrix(blocks) if sparse else blocks, given.q, lb=given.lb))
    for P in (given.P, blocks, np.diag(np.diag(given.P)), given.P):
        solver.update(P=P)
        expected = ready(Lane.DIRECT, name, Problem(P, given.q, lb=given.lb)).solve()
        np.testing.assert_allclose(solver.solve(), expected, atol=2.0 * DIRECT[name].mid, rtol=0)


@each_solver
def test_an_answer_is_that_of_the_last_data_whatever_was_solved_before_and_a_solution_outlives_the_next_solve(
    lane: Lane, name: str
) -> None:
    problem, which = pair(richest(lane, name), 9), 0
    solver = ready(lane, name, problem.problems[0])
    for step in "sosswwqsowsoowPqw":  # solve cold or warm, pass the data of the other problem, pass q or P again
        which = 1 - which if step == "o" else which
        if step in "oPq":
            solver.update(**{part: getattr(problem.problems[which], part) for part in step.replace("o", "Pq")})
        else:
            start = problem.answers[1 - which] if step == "w" and solver.warm_startable else None
            assert problem.error(solver.solve(start), which) <= stated(lane, name).mid
    solution = solver.solution()
    solver.update(problem.problems[1 - which].P, problem.problems[1 - which].q)
    solver.solve()
    assert problem.error(solution.x, which) <= stated(lane, name).mid
    np.testing.assert_array_equal(solution.problem.q, problem.problems[which].q)


LAYOUTS: list[Callable[[Any], Any]] = [
    strided_and_locked,
    np.asfortranarray,
    *(lambda a, sparse=sparse: sparse(a) if a.ndim == 2 else a for sparse in (csc_matrix, csr_matrix)),
]


@pytest.mark.parametrize("layout", LAYOUTS, ids=["strided", "Fortran", "columns", "rows"])
@each_solver
def test_arrays_handed_in_are_read_in_any_layout_and_neither_written_nor_kept(
    lane: Lane, name: str, layout: Callable[[Any], Any]
) -> None:
    problem, error = pair(richest(lane, name), 8), stated(lane, name).mid
    first, second = ({key: layout(value) for key, value in arrays(p).items()} for p in problem.problems)
    solver = ready(lane, name, Problem(**first))
    assert problem.error(solver.solve()) <= error
    if issparse(first["P"]):
        return  # updates are of dense arrays
    solver.update(second["P"], second["q"])
    assert problem.error(solver.solve(warm_start=layout(problem.answers[1])), 1) <= error
    solver.solution()
    for given, kept in zip((first, second), problem.problems, strict=True):
        for key, value in given.items():
            np.testing.assert_array_equal(value, getattr(kept, key))
    if layout is np.asfortranarray:
        P, q = second["P"].copy(), second["q"].copy()
        solver.update(P, q)
        P[:], q[:] = 0.0, 1e3
    assert problem.error(solver.solve(), 1) <= error


@pytest.mark.filterwarnings("ignore::UserWarning")  # of qpsolvers and cvxpy, and true
@pytest.mark.parametrize(("lane", "name"), parts(case for case in ALL if "rows" in stated(*case).forms))
def test_rows_that_contradict_each_other_are_never_called_found(lane: Lane, name: str) -> None:
    eye = np.eye(3)
    rows = {"G": np.vstack([eye[:1], -eye[:1]]), "h": np.array([-1.0, -1.0])}  # no x is at most −1 and at least 1
    solver = ready(lane, name, Problem(eye, np.ones(3), **rows, lb=np.full(3, -5.0)))
    x, solution = solver.solve(), solver.solution()
    assert solution.found is False
    assert solution.extras["status"]
    np.testing.assert_array_equal(x, np.full(x.shape, np.nan) if solution.x is None else solution.x)


@pytest.mark.parametrize("lane", [Lane.DIRECT, Lane.QPSOLVERS])
def test_a_library_that_breaks_on_a_problem_has_no_answer(lane: Lane) -> None:
    broken = Problem(np.eye(2), np.ones(2), lb=np.full(2, -1e30), ub=np.full(2, 1e30))
    assert np.isnan(ready(lane, "cvxopt", broken).solve()).all()


@pytest.mark.filterwarnings("ignore::UserWarning")  # of qpsolvers and cvxpy, and true
@pytest.mark.parametrize(("lane", "name"), [case for case in ALL if case[1] in LIMIT and case not in SILENT])
def test_an_answer_that_a_library_does_not_call_found_is_kept_with_its_duals_and_its_status(
    lane: Lane, name: str
) -> None:
    problem = pair("boxes", 18)
    solver = ready(lane, name, problem.problems[0], **{LIMIT[name]: 2})
    x, solution = solver.solve().copy(), solver.solution()
    assert solution.found is False
    assert solution.extras["status"] not in ("", "solved", "optimal")
    np.testing.assert_array_equal(solution.x, x)
    assert problem.error(x) < 30.0
    assert np.isfinite(solution.z_box).all()


@each_common
def test_a_singular_P_is_answered_right_or_not_at_all(name: str) -> None:
    rng = np.random.default_rng(3)
    B = rng.normal(size=(4, 10))
    solver = ready(Lane.DIRECT, name, Problem(B.T @ B, rng.normal(size=10), lb=np.zeros(10), ub=np.ones(10)), 1e-9)
    x, solution = solver.solve(), solver.solution()
    assert bool(solution.found) == (name not in ("pyqpmad", "quadprog"))
    assert solution.is_optimal(1e-6) if solution.found else np.isnan(x).all()


@each_common
def test_a_row_of_G_without_a_bound_is_ignored(name: str) -> None:
    problem = pair("one-sided", 6)
    p = problem.problems[0]
    solver = ready(Lane.DIRECT, name, Problem(p.P, p.q, np.ones((2, 6)), np.array([np.inf, 1e4]), lb=p.lb, ub=p.ub))
    assert problem.error(solver.solve()) <= DIRECT[name].mid
    np.testing.assert_allclose(solver.solution().z, 0, atol=1e-6)


@pytest.mark.parametrize(("lane", "name"), parts(QUICK))
def test_a_start_keeps_the_answer_helps_if_the_class_declares_it_and_has_no_later_effect(lane: Lane, name: str) -> None:
    problem, error = pair("boxes" if "boxes" in stated(lane, name).forms else "one-sided", 20), stated(lane, name).mid
    solver = ready(lane, name, problem.problems[0])
    answers, counts = [], []
    for start in (None, None, problem.answers[0], None, problem.answers[1], np.full(20, 50.0), np.zeros(20)):
        answers.append(solver.solve(warm_start=start).copy())
        counts.append(solver.solution().extras["iterations"])
        assert problem.error(answers[-1]) <= error
    if lane is not Lane.DIRECT:
        np.testing.assert_allclose(answers[1], answers[0], rtol=1e-12, atol=1e-14)
        assert not (solver.warm_startable and np.array_equal(answers[2], answers[1]))
        return
    assert solver.warm_startable == DIRECT[name].warm
    assert counts[3] == counts[1]
    assert counts[0] == counts[1] or name in ("osqp", "scs")  # which keep the penalty adapted by the last solve
    if not solver.warm_startable:
        np.testing.assert_array_equal(answers[2], answers[1])
    elif name not in UNCOUNTED:
        assert counts[2] < counts[1]


@pytest.mark.parametrize(("lane", "name"), [*product([Lane.DIRECT], SPREAD), *product([Lane.KERNEL], COMPILED)])
def test_a_setting_that_a_library_does_not_have_is_refused(lane: Lane, name: str) -> None:
    named = f"{name * (lane is Lane.KERNEL)}.*no_such_setting"
    with pytest.raises((AttributeError, TypeError, ValueError), match=named):
        ready(lane, name, pair("one-sided", 3).problems[0], no_such_setting=1)


def test_every_library_with_a_file_of_its_own_is_tested_here() -> None:
    own = {entry.name for entry in solvers.entries() if entry.lane is Lane.DIRECT and not entry.path}
    assert own - OURS - {*COMMERCIAL} == {*DIRECT}


def test_the_time_limit_of_highspy_counts_from_each_solve() -> None:
    solver = ready(Lane.DIRECT, "highspy", pair("one-sided", 8).problems[0], time_limit=2.0)
    for _ in range(3):
        before = solver._highs.getRunTime()
        solver.solve()
        assert solver._highs.getOptionValue("time_limit")[1] == before + 2.0
    assert before > 0


def test_a_solver_without_its_library_or_whose_distribution_is_not_installed_is_absent_with_the_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delitem(sys.modules, "solvers.direct.clarabel", raising=False)
    monkeypatch.setitem(sys.modules, "clarabel", None)
    assert "clarabel" in solvers.describe(solvers.find("clarabel", Lane.DIRECT)).absent
    entry = solvers.find("box_active_set")
    monkeypatch.setattr(entry.load(), "distribution", "no_such_package")
    assert "'no_such_package', which is not installed" in solvers.describe(entry).absent


@pytest.mark.parametrize("lane", LANES)
def test_a_lane_refuses_a_solver_that_is_not_in_its_table(lane: Lane) -> None:
    assert LANES[lane].INSTALLED
    with pytest.raises(ImportError, match="'no_such_solver'"):
        LANES[lane].make("no_such_solver")


def test_an_unknown_solver_imports_no_cvxpy_and_a_library_that_does_not_load_is_absent_in_silence(
    tmp_path: Path,
) -> None:
    (tmp_path / "proxsuite.py").write_text(
        "raise ImportError('libgomp.so.1: cannot open shared object file: No such file or directory')\n"
    )
    program = (
        "import sys, solvers\ntry:\n    solvers.find('nope')\nexcept KeyError:\n    print('cvxpy' in sys.modules)\n"
        "from solvers import cvxpy_lane\nprint('proxqp' in cvxpy_lane.INSTALLED)"
    )
    done = python("-c", program, first=tmp_path)
    assert (done.stdout, done.stderr) == ("False\nFalse\n", "")


def test_cvxpy_compiles_the_problem_once_since_it_is_dpp_and_reports_the_time_of_the_library() -> None:
    first, second = pair("rows", 6).problems
    solver = ready(Lane.CVXPY, "clarabel", first)
    assert solver.model.is_dcp(dpp=True)
    compiled = solver.model._cache.param_prog
    assert compiled is not None
    for given in (first, second):
        solver.update(given.P, given.q)
        solver.solve()
        assert solver.model._cache.param_prog is compiled
    assert 0.0 < solver.solution().extras["reported_us"] < 1e8


def test_the_square_root_of_a_singular_cost_still_gives_that_cost() -> None:
    root = square_root(np.ones((3, 3)))
    np.testing.assert_allclose(root.T @ root, np.ones((3, 3)), atol=1e-12)
