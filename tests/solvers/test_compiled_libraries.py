"""The compiled lane: libraries by their C functions, and the loop that times a solver."""

import ctypes
import importlib
import importlib.metadata
import sys
from pathlib import Path
from typing import Any

import box_programs
import numpy as np
import pytest
from programs import library, solver_class

import solvers
from solvers import Entry, Lane, Problem, Solver, Unsupported, describe
from solvers.protocol import Matrix, Vector

NAMES = ("daqp", "quadprog")
LIMITED: dict[str, dict[str, Any]] = {"daqp": {"iter_limit": 2}}
"""Too few iterations for a program with active bounds; the others are given a P that is not positive definite."""


def both(name: str, problem: Problem | None = None, **settings: Any) -> tuple[Solver, Solver]:
    """The solver in the compiled lane and in the direct one, ready for a problem."""
    compiled, direct = (solver_class(solvers.find(name, lane))(**settings) for lane in (Lane.KERNEL, Lane.DIRECT))
    if problem is not None:
        compiled.setup(problem)
        direct.setup(problem)
    return compiled, direct


def tightest(name: str) -> dict[str, Any]:
    """The tightest rung."""
    return dict(solver_class(solvers.find(name, Lane.DIRECT)).ladder(1.0)[-1])


def programs(form: str, d: int, count: int, seed: int = 0) -> tuple[Problem, Matrix, Matrix]:
    """A feasible program, and P (n, d, d) and q (n, d) under its constraints; the first are its own."""
    rng = np.random.default_rng([seed, d])
    A = rng.normal(size=(count, 2 * d, d)) * 10.0 ** rng.uniform(-1.5, 1.5, d)
    P, q = A.transpose(0, 2, 1) @ A, 30.0 * rng.normal(size=(count, d))
    lb = np.where(rng.random(d) < (0.3 if form == "mixed" else 0.0), -np.inf, -rng.random(d))
    ub = np.full(d, np.inf) if form == "one-sided" else rng.random(d)
    if form == "mixed":
        lb[0] = ub[0] = 0.1
    rows = (
        {"G": rng.normal(size=(3, d)), "h": np.full(3, 0.5), "A": rng.normal(size=(1, d)), "b": np.zeros(1)}
        if form == "rows"
        else {}
    )
    return Problem(P[0], q[0], lb=lb, ub=ub, **rows), P, q


@pytest.mark.parametrize("warm", [False, True])
@pytest.mark.parametrize("d", [2, 18, 40])
@pytest.mark.parametrize("form", ["boxes", "one-sided", "mixed", "rows"])
@pytest.mark.parametrize("name", NAMES)
def test_the_compiled_answers_are_those_of_the_direct_lane(name: str, form: str, d: int, warm: bool) -> None:
    problem, P, q = programs(form, d, 30)
    compiled, direct = both(name, problem, **tightest(name))
    start = np.clip(0.3 * np.ones(d), problem.lb, problem.ub) if warm else None
    np.testing.assert_array_equal(compiled.solve(start), direct.solve(start))
    *_, answers = compiled.time_kernel(P, q, start)
    for k, answer in enumerate(answers):
        direct.update(P[k], q[k])
        np.testing.assert_array_equal(answer, direct.solve(start))
    assert np.isfinite(answers).all()
    found, expected = compiled.solution(), direct.solution()
    assert found.found
    assert found.extras["status"]
    for part in ("x", "y", "z", "z_box"):
        np.testing.assert_array_equal(getattr(found, part), getattr(expected, part))
    for part in ("status", "iterations"):
        assert found.extras[part] == expected.extras[part]


@pytest.mark.parametrize("name", NAMES)
def test_a_library_has_the_ladder_and_the_description_of_its_direct_lane_which_is_meant_by_its_name_alone(
    name: str,
) -> None:
    compiled, direct = (type(solver) for solver in both(name))
    assert (compiled.lane, compiled.distribution, compiled.ladder(0.2)) == (Lane.KERNEL, name, direct.ladder(0.2))
    for part in ("name", "algorithm", "licence", "warm_startable", "fixed_settings"):
        assert getattr(compiled, part) == getattr(direct, part)
    assert solvers.find(name, Lane.KERNEL).times_itself
    assert [(entry.name, entry.lane) for entry in solvers.entries()].count((name, Lane.DIRECT)) == 1
    by_name_alone = solvers.find(name).module, solvers.find("box_active_set").lane
    assert by_name_alone == (f"solvers.direct.{name}", Lane.KERNEL)


def test_the_settings_of_daqp_are_at_their_offsets() -> None:
    both("daqp")
    module = importlib.import_module("solvers.kernel.daqp")
    settings = module.Settings()
    module.DAQP.daqp_default_settings(ctypes.byref(settings))
    assert {field: getattr(settings, field) for field, _ in settings._fields_} == library("daqp").Model().settings


@pytest.mark.parametrize("name", NAMES)
def test_data_without_an_answer_found_have_what_the_library_returned_in_their_row_alone(name: str) -> None:
    problem, P, q = programs("boxes", 6, 3)
    compiled, direct = both(name, **LIMITED.get(name, {}))
    for solver in (compiled, direct):
        solver.setup(Problem(np.eye(6), np.zeros(6), lb=problem.lb, ub=problem.ub))
    P[[0, 2]], q[[0, 2]] = np.eye(6), 0.0
    P[1] *= 1.0 if name in LIMITED else -1.0
    *_, answers = compiled.time_kernel(P, q)
    direct.update(P[1], q[1])
    np.testing.assert_array_equal(answers[1], direct.solve())
    assert np.isnan(answers[1]).all() == (name not in LIMITED)
    assert np.isfinite(answers[[0, 2]]).all()
    for k in (2, 1):
        compiled.time_kernel(P[[k]], q[[k]])
        assert compiled.solution().found == (k == 2)
    np.testing.assert_array_equal(compiled.solve(), answers[1])


def test_data_that_daqp_refuses_are_refused_in_the_loop_with_its_flag_as_in_an_update() -> None:
    problem, P, q = programs("boxes", 6, 3)
    compiled, direct = both("daqp", problem, **tightest("daqp"))
    P[1] = -np.eye(6)
    for solver, take, data in ((direct, direct.update, (P[1], q[1])), (compiled, compiled.time_kernel, (P, q))):
        with pytest.raises(Unsupported, match="exit flag -5"):
            take(*data)
        with pytest.raises(ValueError, match=r"daqp is not ready until the next good setup\(problem\)"):
            solver.update(P[2], q[2])


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", NAMES)
def test_the_memory_of_a_library_is_freed_with_its_solver(name: str) -> None:
    problem, *_ = programs("boxes", 100, 1)
    resident_kb = []
    for count in (50, 110):
        for _ in range(count):
            compiled, _ = both(name)
            compiled.setup(problem)
            compiled.solve()
        resident_kb.append(4 * int(Path("/proc/self/statm").read_text().split()[1]))
    assert resident_kb[1] - resident_kb[0] < 10_000  # each of 110 has 120 kB and more


@pytest.mark.parametrize("name", NAMES)
def test_another_version_is_absent_in_the_compiled_lane_alone_with_a_sentence(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    both(name)
    real = importlib.metadata.version
    monkeypatch.delitem(sys.modules, f"solvers.kernel.{name}")
    monkeypatch.setattr(importlib.metadata, "version", lambda queried: "99.1" if queried == name else real(queried))
    reason = describe(solvers.find(name, Lane.KERNEL)).absent
    assert reason == f"the C interface of {name} is supported in version {real(name)}, but 99.1 is installed"
    assert not describe(solvers.find(name, Lane.DIRECT)).absent


def test_a_library_without_its_functions_or_without_its_file_is_absent_with_a_sentence(tmp_path: Path) -> None:
    from solvers.kernel._library import open_library

    version, said = (
        importlib.metadata.version("daqp"),
        "^the library of daqp .* does not offer its C functions here: ",
    )
    for path, function, reason in (
        (Path(library("daqp").__file__), "daqp_fly", "undefined symbol: daqp_fly$"),
        (tmp_path / "nothing.so", "daqp_solve", "cannot open shared object file"),
    ):
        with pytest.raises(ImportError, match=f"{said}.*{reason}"):
            open_library("daqp", version, path, ("daqp_solve", function))


D = 9
each_kernel = pytest.mark.parametrize(
    "entry",
    [entry for entry in solvers.entries() if entry.lane is Lane.KERNEL and entry.times_itself],
    ids=lambda entry: entry.name,
)


def data(count: int, seed: int = 0) -> tuple[Matrix, Matrix]:
    """Well conditioned P (n, d, d) and q (n, d), so that every solver comes to the optimum."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(count, 4 * D, D))
    return A.transpose(0, 2, 1) @ A / D, rng.normal(size=(count, D))


def optimum(P: Matrix, q: Vector) -> Vector:
    return box_programs.optimum(Problem(P, q, lb=np.full(D, -0.1), ub=np.full(D, 0.2)))


def ready(entry: Entry, **settings: Any) -> Solver:
    cls = solver_class(entry)
    steps = {"steps": 300} if entry.name == "projected_difference" else {}
    solver = cls(**{**cls.ladder(1.0)[-1], **steps, **settings})
    (P,), (q,) = data(1, seed=99)
    solver.setup(Problem(P, q, lb=np.full(D, -0.1), ub=np.full(D, 0.2)))
    return solver


@each_kernel
@pytest.mark.parametrize("warm", [False, True])
@pytest.mark.parametrize("fixed", [False, True])
def test_a_loop_answers_each_of_its_data_of_any_stride_as_calls_from_python_do_and_leaves_the_last_to_be_solved_again(
    entry: Entry, warm: bool, fixed: bool
) -> None:
    timed, called, given, (first, _) = ready(entry), ready(entry), data(40), data(1, seed=99)
    P, q = given[0][::2], given[1][::-2]
    P.flags.writeable = q.flags.writeable = False
    start = np.full(D, 0.2) if warm else None
    updates, solves, answers = timed.time_kernel(None if fixed else P, q, start)
    assert updates.shape == solves.shape == (20,)
    assert ((updates >= 0) & (solves > 0)).all()
    for k, answer in enumerate(answers):
        called.update(None if fixed else P[k], q[k])
        np.testing.assert_array_equal(answer, called.solve(start))
        np.testing.assert_allclose(answer, optimum(first[0] if fixed else P[k], q[k]), rtol=0.0, atol=1e-7)
    last_P, last_q = first[0] if fixed else P[-1].copy(), q[-1].copy()
    for array in given:
        array[:] = np.nan  # no solver keeps a pointer to them
    solution = timed.solution()
    assert solution.found
    np.testing.assert_array_equal(solution.x, answers[-1])
    for array, expected in ((solution.problem.P, last_P), (solution.problem.q, last_q)):
        np.testing.assert_allclose(array, expected, rtol=1e-14)
    np.testing.assert_allclose(timed.solve(), answers[-1], rtol=0.0, atol=1e-7 if warm else 1e-12)
    timed.update(q=-last_q)
    np.testing.assert_allclose(timed.solve(), optimum(last_P, -last_q), rtol=0.0, atol=1e-7)


@each_kernel
def test_no_call_begins_after_the_time_is_spent(entry: Entry) -> None:
    solver, (P, q) = ready(entry), data(400)
    updates, solves, answers = solver.time_kernel(P, q, most_ns=20_000)
    assert len(updates) == len(solves) == len(answers) < 400
    *before, last = np.cumsum(updates + solves)
    assert max(before, default=0) <= 20_000 < last
    assert np.isfinite(answers).all()
    assert len(solver.time_kernel(P, q, most_ns=0)[0]) == 1
