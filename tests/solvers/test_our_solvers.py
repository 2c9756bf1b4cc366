"""Common behaviour of our own solvers: refused problems, and treatment of input data."""

import pickle

import numpy as np
import pytest
from allocations import left_by
from box_programs import INF, random_program, spectrum_matrix
from qpsolvers import Problem

from solvers import Solver, Unsupported, get

EYE, ONES, ZEROS = np.eye(2), np.ones(2), np.zeros(2)
SETTINGS = {
    "box_active_set": {},
    "recursive_active_set": {"proximal": 0.0},
    "projected_difference": {"steps": 20},
    "accelerated_projection": {"diagonal_scaling": True},
}
each_solver = pytest.mark.parametrize("name", SETTINGS)


def ready(name: str, problem: Problem) -> Solver:
    solver = get(name, "kernel", **SETTINGS[name])
    solver.setup(problem)
    return solver


def boxed(P: object, q: object) -> Problem:
    return Problem(P, q, lb=np.full(2, -INF), ub=np.full(2, INF))


REFUSED = {
    "inequalities": (Problem(EYE, ZEROS, np.ones((1, 2)), np.ones(1)), Unsupported, "bounds only"),
    "a bound as a row": (Problem(EYE, ZEROS, np.array([[1.0, 0.0]]), np.ones(1)), Unsupported, "has general rows"),
    "equalities": (Problem(EYE, ZEROS, A=np.ones((1, 2)), b=np.ones(1)), Unsupported, "bounds only"),
    "no variables": (Problem(np.zeros((0, 0)), np.zeros(0), lb=np.zeros(0)), Unsupported, "without variables"),
    "NaN in P": (Problem(np.full((2, 2), np.nan), ZEROS), ValueError, "must be finite"),
    "NaN on the diagonal": (Problem(np.diag([1.0, np.nan]), ZEROS), ValueError, "must be finite"),
    "infinite q": (Problem(EYE, np.array([0.0, INF])), ValueError, "must be finite"),
    "not symmetric": (Problem(np.array([[1.0, 0.5], [0.0, 1.0]]), ZEROS), ValueError, "not symmetric"),
    "indefinite": (Problem(np.array([[1.0, 2.0], [2.0, 1.0]]), ZEROS), ValueError, "P is indefinite beyond rounding"),
    "slightly indefinite": (Problem(np.diag([1.0, -1e-9]), ZEROS), ValueError, "P is indefinite beyond rounding"),
    "crossing bounds": (Problem(EYE, ZEROS, lb=ONES, ub=ZEROS), ValueError, "above its upper bound"),
    "a bound at +inf": (Problem(EYE, ZEROS, lb=np.array([0.0, INF]), ub=np.array([1.0, INF])), ValueError, "above"),
    "a bound at -inf": (Problem(EYE, ZEROS, lb=np.array([0.0, -INF]), ub=np.array([1.0, -INF])), ValueError, "above"),
    "a NaN bound": (Problem(EYE, ZEROS, lb=np.array([0.0, np.nan])), ValueError, "NaN"),
    "a NaN upper bound": (Problem(EYE, ZEROS, ub=np.array([0.0, np.nan])), ValueError, "NaN"),
}


@pytest.mark.parametrize("what", REFUSED)
@each_solver
def test_a_problem_that_cannot_be_solved_is_refused_in_one_sentence(name: str, what: str) -> None:
    problem, error, sentence = REFUSED[what]
    with pytest.raises(error, match=sentence) as refused:
        ready(name, problem)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("P", "q"),
    [
        (np.eye(3), ZEROS),
        (EYE, np.zeros(3)),
        (np.ones(4), ZEROS),
        (EYE, np.zeros((2, 1))),
        (EYE[:, :1], ZEROS),
        (np.diag([1.0, np.nan]), ZEROS),
        (EYE, np.array([-INF, 0.0])),
        (np.array([[1.0, 0.5], [0.0, 1.0]]), ZEROS),
    ],
)
@each_solver
def test_data_that_do_not_fit_are_refused_by_an_update(name: str, P: np.ndarray, q: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"shape|size|finite|symmetric"):
        ready(name, boxed(EYE, ZEROS)).update(P, q)


def test_a_warm_start_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="finite"):
        ready("box_active_set", boxed(EYE, ZEROS)).solve(np.array([0.0, np.nan]))


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


AS_GIVEN = {
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
