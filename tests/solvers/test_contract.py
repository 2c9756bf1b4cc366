"""The contract of our own solvers: what they refuse, what a refusal leaves, and how they treat input data."""

import pickle
import re
import tracemalloc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from box_programs import INF, random_program, spectrum_matrix
from qpsolvers import Problem

from solvers import Solver, Unsupported, get

EYE, ONES, ZEROS = np.eye(2), np.ones(2), np.zeros(2)
SETTINGS: dict[str, dict[str, Any]] = {
    "box_active_set": {},
    "projected_difference": {"steps": 20},
    "accelerated_projection": {"diagonal_scaling": True},
}
each_solver = pytest.mark.parametrize("name", SETTINGS)


def ready(name: str, problem: Problem) -> Solver:
    solver = get(name, "kernel", **SETTINGS.get(name, {}))
    solver.setup(problem)
    return solver


def boxed(P: object, q: object) -> Problem:
    return Problem(P, q, lb=np.full(2, -INF), ub=np.full(2, INF))


REFUSED = {
    "inequalities": (Problem(EYE, ZEROS, np.ones((1, 2)), np.ones(1)), Unsupported, "bounds only"),
    "a bound as a row": (Problem(EYE, ZEROS, np.array([[1.0, 0.0]]), np.ones(1)), Unsupported, "has general rows"),
    "equalities": (Problem(EYE, ZEROS, A=np.ones((1, 2)), b=np.ones(1)), Unsupported, "bounds only"),
    "no variables": (Problem(np.zeros((0, 0)), np.zeros(0), lb=np.zeros(0)), Unsupported, "without variables"),
    "indefinite": (Problem(np.array([[1.0, 2.0], [2.0, 1.0]]), ZEROS), ValueError, "P is indefinite beyond rounding"),
    "slightly indefinite": (Problem(np.diag([1.0, -1e-9]), ZEROS), ValueError, "P is indefinite beyond rounding"),
}


@pytest.mark.parametrize("what", REFUSED)
@each_solver
def test_a_problem_that_cannot_be_solved_is_refused_in_one_sentence_and_leaves_a_solver_as_it_was(
    name: str, what: str
) -> None:
    problem, error, sentence = REFUSED[what]
    solver = ready(name, boxed(EYE, -ONES))
    x = solver.solve().copy()
    with pytest.raises(error, match=sentence) as refused:
        solver.setup(problem)
    assert "\n" not in str(refused.value)
    assert solver.solution().found
    np.testing.assert_array_equal(solver.solution().x, x)
    np.testing.assert_array_equal(solver.solve(), x)


NOT_DATA: dict[str, tuple[dict[str, Any], str]] = {
    "P of another size": ({"P": np.eye(3), "q": np.zeros(2)}, "P must be of shape (2, 2), and not (3, 3)"),
    "P of one column": ({"P": np.ones((2, 1))}, "P must be of shape (2, 2), and not (2, 1)"),
    "P of one dimension": ({"P": np.ones(4)}, "P must be of shape (2, 2), and not (4,)"),
    "q of another size": ({"q": np.zeros(3)}, "q must be of shape (2,), and not (3,)"),
    "a number": ({"q": 3.0}, "q must be of shape (2,), and not ()"),
    "q of two dimensions": ({"P": EYE, "q": np.zeros((2, 1))}, "q must be of shape (2,), and not (2, 1)"),
    "complex P": ({"P": EYE + 1j}, "P must be made of real numbers, and not of complex128"),
    "text": ({"q": ["a", "b"]}, "q must be made of real numbers, and not of <U1"),
}


@pytest.mark.parametrize("what", NOT_DATA)
@each_solver
def test_arrays_of_another_shape_or_type_are_refused_and_change_nothing(name: str, what: str) -> None:
    data, sentence = NOT_DATA[what]
    solver = ready(name, boxed(EYE, -ONES))
    x = solver.solve().copy()
    with pytest.raises(ValueError, match=f"^{re.escape(sentence)}$"):
        solver.update(**data)
    assert solver.solution().found
    np.testing.assert_array_equal(solver.solve(), x)
    if what not in ("a number", "text", "q of two dimensions"):  # which qpsolvers.Problem itself refuses or flattens
        with pytest.raises(ValueError, match=r"must be (of shape|made of)"):
            ready(name, boxed(data.get("P", EYE), data.get("q", ZEROS)))


NOT_NUMBERS = {
    "NaN in P": ({"P": np.diag([1.0, np.nan]), "q": ZEROS}, "P must be finite"),
    "infinite q": ({"P": EYE, "q": np.array([-INF, 0.0])}, "q must be finite"),
    "NaN in q alone": ({"q": np.array([np.nan, 0.0])}, "q must be finite"),
    "not symmetric": ({"P": np.array([[1.0, 0.5], [0.0, 1.0]])}, "P is not symmetric"),
    "indefinite": ({"P": np.array([[1.0, 2.0], [2.0, 1.0]]), "q": ZEROS}, "P is indefinite"),
    "a negative diagonal": ({"P": -EYE}, "P is indefinite"),
}


@pytest.mark.parametrize("what", NOT_NUMBERS)
@each_solver
def test_after_a_refused_update_nothing_is_answered_until_its_arrays_come_again(name: str, what: str) -> None:
    data, sentence = NOT_NUMBERS[what]
    solver = ready(name, boxed(2.0 * EYE, -ONES))
    solver.solve()
    with pytest.raises(ValueError, match=f"^{name}: {sentence}"):
        solver.update(**data)
    needed = " and ".join(sorted(data))
    for call in (solver.solve, solver.solution, lambda: solver.solve(ZEROS)):
        with pytest.raises(ValueError, match=f"not ready until the next good update of {needed}$"):
            call()
    good = {"P": EYE, "q": -ONES}
    if len(data) == 2:
        solver.update(q=good["q"])
        with pytest.raises(ValueError, match=r"not ready until the next good update of P$"):
            solver.solve()
    solver.update(**{key: good[key] for key in data})
    fresh = ready(name, boxed(good["P"] if "P" in data else 2.0 * EYE, -ONES))
    np.testing.assert_array_equal(solver.solve(), fresh.solve())
    assert solver.solution().found


@pytest.mark.parametrize(
    ("name", "settings", "sentence"),
    [
        *((name, {"stpes": 3}, f"{name} has no setting 'stpes'; it has ") for name in SETTINGS),
        (
            "box_active_set",
            {"tolerance": 1e-9},
            "box_active_set has no setting 'tolerance'; it has warm, most_exchanges",
        ),
        ("box_active_set", {"warm": "no"}, "box_active_set: warm must be True or False, and it is 'no'"),
        ("box_active_set", {"most_exchanges": -1}, "most_exchanges must be a whole number from 0 to 2147483647"),
        ("projected_difference", {"steps": 1.5}, "projected_difference: steps must be a whole number from 0 to"),
        ("projected_difference", {"tolerance": -1.0}, "tolerance must be a number and not negative, and it is -1.0"),
        ("projected_difference", {"step_ratio": np.nan}, "step_ratio must be a number and not negative"),
        ("accelerated_projection", {"tolerance": -1.0}, "tolerance must be a number and not negative, and it is -1.0"),
        ("accelerated_projection", {"tolerance": None}, "tolerance must be a number and not negative, and it is None"),
        ("accelerated_projection", {"diagonal_scaling": 1}, "diagonal_scaling must be True or False, and it is 1"),
    ],
)
def test_a_setting_that_is_misspelt_or_out_of_range_is_refused(name: str, settings: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        get(name, **settings)


@each_solver
def test_inputs_are_not_written_and_may_change_afterwards(name: str) -> None:
    given, start = random_program(7, 12, 2.0), np.ones(12)
    kept = [array.copy() for array in (*given, start)]
    P, q, lb, ub = given
    solver = ready(name, Problem(P, q, lb=lb, ub=ub))
    solver.update(P, q)
    x = solver.solve(start).copy()
    for array, before in zip((*given, start), kept, strict=True):
        np.testing.assert_array_equal(array, before)
        array[:] = 7.0
    np.testing.assert_allclose(solver.solve(kept[-1]), x, rtol=0, atol=1e-12)


AS_GIVEN: dict[str, Callable[[np.ndarray], Any]] = {
    "contiguous": np.array,
    "Fortran": np.asfortranarray,
    "strided": lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
    "single precision": np.float32,
    "other byte order": lambda a: a.astype(">f8"),
    "list": np.ndarray.tolist,
    "subclass": np.ma.array,
    "pickled": lambda a: pickle.loads(pickle.dumps(a)),
    "locked": lambda a: np.broadcast_to(a, a.shape),
}


@pytest.mark.parametrize("form", AS_GIVEN)
def test_data_may_come_in_any_form_that_numpy_takes(form: str) -> None:
    P, q = np.array([[2.0, 0.5], [0.5, 3.0]]), -ONES
    solver = ready("box_active_set", boxed(EYE, ZEROS))
    solver.update(AS_GIVEN[form](P), AS_GIVEN[form](q))
    np.testing.assert_allclose(P @ solver.solve(), [1.0, 1.0], atol=1e-14)


@each_solver
def test_P_and_q_may_be_renewed_alone(name: str) -> None:
    (P, q, lb, ub), (new, r, *_) = random_program(12, 7, 3.0), random_program(13, 7, 3.0)
    solver = ready(name, Problem(P, q, lb=lb, ub=ub))
    for changes, now in (({"q": r}, (P, r)), ({"P": new}, (new, r)), ({}, (new, r))):
        solver.update(**changes)
        fresh = ready(name, Problem(*now, lb=lb, ub=ub))
        np.testing.assert_array_equal(solver.solve(), fresh.solve())
        np.testing.assert_allclose(solver.solution().problem.P, now[0], rtol=1e-14)


def left_by(call: Callable[[], object], times: int) -> int:
    """Bytes that this many calls leave allocated, after ten that may fill caches."""
    tracemalloc.start()
    try:
        for _ in range(10):
            call()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(times):
            call()
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()


@each_solver
def test_many_updates_and_solves_allocate_nothing_that_stays(name: str) -> None:
    rng = np.random.default_rng(10)
    solver = ready(name, Problem(spectrum_matrix(rng, 18, 2.0), rng.normal(size=18), lb=np.zeros(18)))
    q = rng.normal(size=18)

    def update_and_solve() -> None:
        solver.update(q=q)
        solver.solve()

    assert left_by(update_and_solve, 500) < 1024


@each_solver
def test_a_solution_is_the_callers_own(name: str) -> None:
    P, q, lb, ub = random_program(7, 12, 2.0)
    solver = ready(name, Problem(P, q, lb=lb, ub=ub))
    solver.solve()
    first = solver.solution()
    kept = solver.solution()
    for array in (first.x, first.z_box, first.problem.P, first.problem.q, first.problem.lb, first.problem.ub):
        array[...] = 7.0
    again = solver.solution()
    for which in ("x", "z_box"):
        np.testing.assert_array_equal(getattr(again, which), getattr(kept, which))
    for which in ("P", "q", "lb", "ub"):
        np.testing.assert_array_equal(getattr(again.problem, which), getattr(kept.problem, which))


@pytest.mark.parametrize("name", [*SETTINGS, "daqp", "quadprog"])
def test_a_solver_in_use_is_refused_to_a_second_thread_and_each_answer_is_right(name: str) -> None:
    d = 200
    A = np.random.default_rng(0).normal(size=(2 * d, d))
    solver = ready(name, Problem(A.T @ A, A.T @ np.ones(2 * d), lb=np.full(d, -0.01)))
    best, refused = solver.solve().copy(), []

    def work() -> bool:
        right = True
        for _ in range(40):
            try:
                x = solver.solve().copy()
            except ValueError as error:
                refused.append(str(error))
            else:
                right &= bool(np.array_equal(x, best))
        return right

    with ThreadPoolExecutor(4) as pool:
        assert all(each.result() for each in [pool.submit(work) for _ in range(4)])
    assert all("another thread" in sentence for sentence in refused)
    np.testing.assert_array_equal(solver.solve(), best)
