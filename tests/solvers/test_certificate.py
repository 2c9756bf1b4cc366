"""The certificate of an optimum against an independent reference: every active set, in fractions."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse
from box_programs import many_weak_rows
from every_active_set import (
    INF,
    boxes,
    constraint_rows,
    corner,
    cost,
    dot,
    feasible_stationary_points,
    fractions,
    gram_problem,
    lowest_cost,
    polyhedra,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from qpsolvers import Problem

from solvers.certificate import (
    Certificate,
    Infeasible,
    NotCertified,
    Unbounded,
    certify,
    exact_cost_gap,
    exact_optimum,
    verify,
)
from solvers.exact import linear_algebra as exact_linear_algebra


def test_an_equality_with_general_rows_solved_by_hand_is_certified() -> None:
    # Nearest point to (1, 2, 3) with sum 1 and x₂ − x₀ ≤ 1: the plane gives (−2/3, 1/3, 4/3), the row then binds.
    problem = Problem(
        np.eye(3),
        np.array([-1.0, -2.0, -3.0]),
        G=np.array([[-1.0, 0.0, 1.0], [1.0, 1.0, 1.0]]),
        h=np.array([1.0, 5.0]),
        A=np.ones((1, 3)),
        b=np.ones(1),
    )
    proof = certify(problem, np.zeros(3))
    assert [str(v) for v in exact_optimum(problem, proof)] == ["-1/6", "1/3", "5/6"]
    assert (proof.rows, proof.equalities) == ((0,), (0,))
    verify(problem, proof)


@settings(max_examples=40, deadline=None)
@given(boxes(), st.lists(st.floats(-10, 10), min_size=4, max_size=4))
def test_a_box_optimum_from_any_start_is_the_best_of_all_active_sets_and_unique_if_no_other_is_as_good(
    problem: Problem, start: list[float]
) -> None:
    proof = certify(problem, np.array(start[: len(problem.q)]))
    verify(problem, proof)
    x = [Fraction(int(v.p), int(v.q)) for v in exact_optimum(problem, proof)]
    points = {tuple(point) for point in feasible_stationary_points(problem)}
    best = min(cost(problem, point) for point in points)
    assert Fraction(proof.value) == cost(problem, x) == best
    # two optima in a box have two extreme points
    assert proof.unique == (sum(cost(problem, point) == best for point in points) == 1)
    assert all(lo <= v <= hi for lo, v, hi in zip(fractions(problem.lb), x, fractions(problem.ub), strict=True))


def walled(problem: Problem, size: float) -> Problem:
    """The same problem inside a large box, so that the reference always finds an optimum."""
    lb = np.maximum(problem.lb, -size)
    return Problem(problem.P, problem.q, problem.G, problem.h, problem.A, problem.b, lb, np.full(lb.size, size))


@pytest.mark.parametrize("prime", [exact_linear_algebra.PRIME, 2, 3], ids=["large prime", "2", "3"])
@settings(max_examples=60, deadline=None)
@given(problem=polyhedra(), start=st.lists(st.floats(-10, 10), min_size=3, max_size=3))
def test_general_rows_end_in_the_best_active_set_a_contradiction_or_a_ray(
    prime: int, problem: Problem, start: list[float]
) -> None:
    d = len(problem.q)
    nearest_to_zero = Problem(np.eye(d), np.zeros(d), problem.G, problem.h, problem.A, problem.b, problem.lb)
    try:
        with pytest.MonkeyPatch.context() as patch:  # small primes choose bad working sets, which may cost pivots only
            patch.setattr(exact_linear_algebra, "PRIME", prime)
            proof = certify(problem, np.array(start[:d]))
    except Infeasible:
        assert lowest_cost(nearest_to_zero) is None
        return
    except Unbounded:
        near, far = (lowest_cost(walled(problem, size)) for size in (1e6, 1e9))
        assert far < near - 10**5
        return
    verify(problem, proof)
    x = [Fraction(int(v.p), int(v.q)) for v in exact_optimum(problem, proof)]
    inequalities, equalities = constraint_rows(problem)
    assert all(dot(a, x) <= b for a, b in inequalities)
    assert all(dot(a, x) == b for a, b in equalities)
    assert max(abs(v) for v in x) < 1e6
    points = list(feasible_stationary_points(walled(problem, 1e6)))
    assert Fraction(proof.value) == cost(problem, x) == min(cost(problem, z) for z in points)
    assert proof.unique == (len({tuple(z) for z in points if cost(problem, z) == Fraction(proof.value)}) == 1)


@pytest.mark.parametrize("d", [18, 60, 140])
def test_a_rough_start_still_ends_in_the_same_proof(d: int) -> None:
    problem = gram_problem(d, seed=d)
    first, *others = (
        certify(problem, start)
        for start in (np.zeros(d), np.ones(d), np.random.default_rng(0).normal(size=d), np.full(d, 1e300))
    )
    verify(problem, first)
    assert 0 < len(first.lower) < d
    assert all(proof == first for proof in (*others, certify(problem, np.array(first.x))))
    assert exact_cost_gap(problem, first, np.array(first.x)).absolute >= 0


@pytest.mark.parametrize("rank", [18, 9, 0])
def test_a_rough_start_among_bounds_and_rows_ends_in_the_same_value(rank: int) -> None:
    rng = np.random.default_rng(rank)
    factor = rng.integers(-8, 9, size=(rank, 18)).astype(float)
    inside = rng.normal(size=18)
    G, A = rng.normal(size=(10, 18)), rng.normal(size=(2, 18))
    q = rng.integers(-9, 10, size=18).astype(float)
    problem = Problem(factor.T @ factor, q, G, G @ inside + 0.1, A, A @ inside, inside - 1, inside + 1)
    proofs = [certify(problem, start) for start in (inside, 100 * rng.normal(size=18))]
    for proof in proofs:
        verify(problem, proof)
    assert proofs[0].value == proofs[1].value


def test_sparse_matrices_are_read_as_their_dense_form() -> None:
    G, h = np.array([[1.0, 1.0]]), np.array([0.5])
    dense = Problem(corner.P, corner.q, G, h, lb=corner.lb, ub=corner.ub)
    P = scipy.sparse.csc_matrix(corner.P)
    sparse = Problem(P, corner.q, scipy.sparse.csc_matrix(G), h, lb=corner.lb, ub=corner.ub)
    assert certify(sparse, np.zeros(2)) == certify(dense, np.zeros(2))


def test_extreme_magnitudes_lose_nothing() -> None:
    P, q = np.diag([1e-300, 1e300]), np.array([-1e-300, -3e300])
    problem = Problem(P, q, lb=np.zeros(2), ub=np.array([5e-324, 2.0]))
    proof = certify(problem, np.zeros(2))
    verify(problem, proof)
    assert proof.x == (5e-324, 2.0)
    assert proof.upper == (0, 1)


def test_a_bound_touched_with_zero_multiplier_is_certified_either_way() -> None:
    problem = Problem(np.eye(2), np.array([0.0, -1.0]), lb=np.zeros(2), ub=np.ones(2))
    proof = certify(problem, np.array([0.0, 1.0]))
    assert (proof.x, proof.unique) == ((0.0, 1.0), True)
    for lower in ((), (0,)):
        for upper in ((), (1,)):
            verify(problem, replace(proof, lower=lower, upper=upper))


def test_equal_bounds_and_repeated_rows_are_certified() -> None:
    problem = Problem(
        np.eye(2),
        np.array([-1.0, -1.0]),
        G=np.array([[1.0, 1.0]] * 3),
        h=np.ones(3),
        A=np.array([[1.0, -1.0], [2.0, -2.0]]),
        b=np.zeros(2),
        lb=np.array([0.5, -INF]),
        ub=np.array([0.5, INF]),
    )
    proof = certify(problem, np.full(2, 0.5))
    verify(problem, proof)
    assert (proof.x, proof.value, len(proof.equalities)) == ((0.5, 0.5), "-3/4", 1)


def test_a_singular_problem_whose_bounds_leave_one_optimum_says_unique() -> None:
    tied = Problem(np.zeros((2, 2)), np.array([1.0, -1.0]), lb=np.zeros(2), ub=np.ones(2))
    assert certify(tied, np.full(2, 0.5)).unique
    # P = 0 and q = 0: all multipliers vanish, and the three rows alone shrink the feasible set to the origin.
    point = Problem(np.zeros((2, 2)), np.zeros(2), G=np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]]), h=np.zeros(3))
    assert certify(point, np.ones(2)).unique
    open_cone = Problem(np.zeros((2, 2)), np.zeros(2), G=point.G[:2], h=np.zeros(2))
    assert not certify(open_cone, np.ones(2)).unique


def test_an_undetermined_variable_is_pinned_at_zero() -> None:
    problem = Problem(np.diag([1.0, 0.0]), np.array([-1.0, 0.0]))
    proof = certify(problem, np.array([0.0, 7.0]))
    assert (proof.x, proof.pinned, proof.unique) == ((1.0, 0.0), (1,), False)
    verify(problem, proof)


def test_an_unbounded_problem_is_refused_with_the_reason() -> None:
    with pytest.raises(Unbounded, match=r"falls without bound .* lower bound of variable 1"):
        certify(Problem(np.diag([1.0, 0.0]), np.array([0.0, -1.0]), lb=np.zeros(2)), np.zeros(2))
    with pytest.raises(Unbounded, match="falls without bound"):
        certify(Problem(np.diag([1.0, 0.0]), np.array([0.0, -1.0])), np.zeros(2))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ({"lb": np.ones(2), "ub": np.zeros(2)}, "(upper|lower) bound of variable 0 against (upper|lower)"),
        ({"G": np.array([[1.0, 1.0], [-1.0, -1.0]]), "h": np.array([0.0, -1.0])}, "inequality row"),
        ({"A": np.ones((2, 2)), "b": np.array([0.0, 1.0])}, "equality row 1 against equality row 0"),
        ({"G": np.zeros((1, 2)), "h": -np.ones(1)}, "its row is zero"),
    ],
    ids=["bounds", "rows", "equalities", "zero row"],
)
@pytest.mark.parametrize("P", [np.eye(2), np.zeros((2, 2))], ids=["strictly convex", "linear"])
def test_an_infeasible_problem_is_refused_with_the_contradiction(P: np.ndarray, rows: dict, message: str) -> None:
    with pytest.raises(Infeasible, match=message):
        certify(Problem(P, np.array([-1.0, 2.0]), **rows), np.zeros(2))


@pytest.mark.parametrize(
    ("name", "value"),
    [("P", np.nan), ("q", INF), ("lb", np.nan), ("lb", INF), ("ub", -INF), ("h", np.nan), ("G", INF), ("b", INF)],
)
def test_nan_and_misplaced_infinities_in_the_data_are_refused_by_name(name: str, value: float) -> None:
    data = {
        "P": np.eye(2),
        "q": np.zeros(2),
        "G": np.ones((1, 2)),
        "h": np.ones(1),
        "A": np.array([[1.0, -1.0]]),
        "b": np.zeros(1),
        "lb": -np.ones(2),
        "ub": np.ones(2),
    }
    data[name].flat[-1] = value
    with pytest.raises(ValueError, match=rf"^{name}\[.*\] is -?(nan|inf), and no exact proof starts from that$"):
        certify(Problem(**data), np.zeros(2))


@pytest.mark.parametrize(
    ("x", "c", "sentence"),
    [
        (np.array([0.0, np.nan]), 0.0, r"x\[1\] is nan"),
        (np.array([INF, 0.0]), 0.0, r"x\[0\] is inf"),
        (np.zeros(3), 0.0, r"x has shape \(3,\), expected \(2,\)"),
        (np.zeros(2), np.nan, "the constant term c is nan"),
    ],
)
def test_an_answer_that_is_not_finite_or_of_the_wrong_shape_is_refused(x: np.ndarray, c: float, sentence: str) -> None:
    proof = certify(corner, np.zeros(2))
    with pytest.raises(ValueError, match=sentence):
        exact_cost_gap(corner, proof, x, c=c)
    if c == 0.0:
        with pytest.raises(ValueError, match=sentence):
            certify(corner, x)


def test_a_proof_that_takes_too_much_work_is_refused() -> None:
    with pytest.raises(NotCertified, match=r"no proof within 1e\+04 bit operations of exact arithmetic"):
        certify(gram_problem(18, seed=1), np.zeros(18), work=1e4)


def test_an_optimum_is_proven_even_if_its_uniqueness_takes_too_much_work() -> None:
    problem = many_weak_rows()
    proof = certify(problem, np.zeros(8), work=1e6)
    assert proof.unique is None
    verify(problem, proof)
    decided = certify(problem, np.zeros(8), work=1e7)
    assert decided == replace(proof, unique=True)
    verify(problem, decided)
    with pytest.raises(NotCertified, match="line 7"):
        verify(problem, replace(proof, unique=False))
    assert Certificate.from_json(proof.to_json()) == proof
    assert exact_cost_gap(problem, proof, np.zeros(8), c=1.0).relative == 0.0
    with pytest.raises(NotCertified, match="no proof within 1e"):
        certify(problem, np.zeros(8), work=1e5)
