"""The certificate against an independent reference: every active set, in fractions.Fraction, without FLINT."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import chain, combinations

import numpy as np
import pytest
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st
from qpsolvers import Problem

from solvers.certificate import (
    Certificate,
    Infeasible,
    NotCertified,
    RoundingDecides,
    Unbounded,
    certify,
    exact_cost_gap,
    exact_optimum,
    verify,
)
from solvers.exact import active_set as exact_active_set
from solvers.exact import linear_algebra as exact_linear_algebra
from solvers.exact.linear_algebra import WORK, Work
from solvers.exact.problem import DoubleProblem

INF = np.inf


# --- the reference ---------------------------------------------------------------------------------------

Row = tuple[list[Fraction], Fraction]


def fractions(values: np.ndarray) -> list:
    return [fractions(v) for v in values] if np.ndim(values) else Fraction(float(values))


def gauss(M: list[list[Fraction]], right: list[Fraction]) -> list[Fraction] | None:
    """Solve by elimination; None where M is singular."""
    n, T = len(M), [[*row, r] for row, r in zip(M, right, strict=True)]
    for k in range(n):
        pivot = next((i for i in range(k, n) if T[i][k] != 0), None)
        if pivot is None:
            return None
        T[k], T[pivot] = T[pivot], T[k]
        T[k] = [entry / T[k][k] for entry in T[k]]
        for i in range(n):
            if i != k and T[i][k] != 0:
                T[i] = [a - T[i][k] * b for a, b in zip(T[i], T[k], strict=True)]
    return [row[-1] for row in T]


def constraint_rows(problem: Problem) -> tuple[list[Row], list[Row]]:
    """Inequalities aᵀx ≤ b and equalities of a problem."""
    d = len(problem.q)
    unit = [[Fraction(int(i == j)) for j in range(d)] for i in range(d)]
    inequalities = [] if problem.G is None else list(zip(fractions(problem.G), fractions(problem.h), strict=True))
    for bound, sign in ((problem.lb, -1), (problem.ub, 1)):
        if bound is not None:
            inequalities += [([sign * e for e in unit[i]], sign * Fraction(float(v)))
                             for i, v in enumerate(bound) if np.isfinite(v)]
    equalities = [] if problem.A is None else list(zip(fractions(problem.A), fractions(problem.b), strict=True))
    return inequalities, [(a, b) for a, b in equalities if any(a) or b]  # 0 = 0 would make every system singular


def dot(a: list[Fraction], b: list[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def cost(problem: Problem, x: list[Fraction]) -> Fraction:
    P, q = fractions(problem.P), fractions(problem.q)
    return dot(x, [dot(row, x) for row in P]) / 2 + dot(q, x)


def feasible_stationary_points(problem: Problem) -> Iterator[list[Fraction]]:
    """The feasible stationary point of every active set whose optimality system is regular."""
    P, q = fractions(problem.P), fractions(problem.q)
    inequalities, equalities = constraint_rows(problem)
    d = len(q)
    for active in chain.from_iterable(combinations(inequalities, k) for k in range(d - len(equalities) + 1)):
        held = [*equalities, *active]
        K = [row + [a[i] for a, _ in held] for i, row in enumerate(P)]
        K += [a + [Fraction(0)] * len(held) for a, _ in held]
        answer = gauss(K, [-v for v in q] + [b for _, b in held])
        if answer is not None and all(dot(a, answer[:d]) <= b for a, b in inequalities):
            yield answer[:d]


def lowest_cost(problem: Problem) -> Fraction | None:
    return min((cost(problem, x) for x in feasible_stationary_points(problem)), default=None)


# --- problems --------------------------------------------------------------------------------------------

small = st.integers(-4, 4)


@st.composite
def boxes(draw: st.DrawFn) -> Problem:
    """A convex problem with bounds only, d ≤ 4; P often singular, bounds often equal, optima often tied."""
    d = draw(st.integers(1, 4))
    factor = np.array(draw(st.lists(st.lists(small, min_size=d, max_size=d), min_size=1, max_size=d)), dtype=float)
    q = np.array(draw(st.lists(small, min_size=d, max_size=d)), dtype=float)
    lb = np.array(draw(st.lists(small, min_size=d, max_size=d)), dtype=float) / 4
    width = np.array(draw(st.lists(st.integers(0, 4), min_size=d, max_size=d)), dtype=float)
    return Problem(factor.T @ factor, q, lb=lb, ub=lb + width)


@st.composite
def polyhedra(draw: st.DrawFn) -> Problem:
    """A convex problem with general rows, d ≤ 3; may be infeasible or unbounded, rows may depend on each other."""
    d = draw(st.integers(1, 3))

    def matrix(low: int, high: int) -> np.ndarray:
        rows = draw(st.lists(st.lists(small, min_size=d, max_size=d), min_size=low, max_size=high))
        return np.array(rows, dtype=float).reshape(-1, d)

    def vector(n: int) -> np.ndarray:
        return np.array(draw(st.lists(small, min_size=n, max_size=n)), dtype=float)

    factor, G, A = matrix(1, d), matrix(0, 4), matrix(0, min(d - 1, 1)) if d > 1 else np.zeros((0, d))
    lb = np.where(vector(d) > 0, -INF, -2.0)
    return Problem(factor.T @ factor, vector(d), G=G if len(G) else None, h=vector(len(G)) if len(G) else None,
                   A=A if len(A) else None, b=vector(len(A)) if len(A) else None, lb=lb)


def gram_problem(d: int, seed: int, rows_per_variable: int = 4) -> Problem:
    """A badly conditioned least-squares problem over x ≥ 0 with about half of the bounds active."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(rows_per_variable * d, d)) + 20 * rng.normal(size=(rows_per_variable * d, 1))
    target = columns @ np.maximum(rng.normal(size=d), 0) + 0.1 * rng.normal(size=len(columns))
    return Problem(columns.T @ columns, -columns.T @ target, lb=np.zeros(d), ub=np.full(d, INF))


corner = Problem(np.array([[2.0, 0.0], [0.0, 4.0]]), np.array([-2.0, 4.0]), lb=np.zeros(2), ub=np.full(2, 3.0))
"""Optimum (1, 0) with V = −1, found by hand: variable 0 free, variable 1 at its lower bound with multiplier 4."""


# --- the optimum -----------------------------------------------------------------------------------------

def test_a_box_problem_solved_by_hand_is_certified() -> None:
    proof = certify(corner, np.array([0.9, 0.2]))
    assert (proof.x, proof.value, proof.value_rounded) == ((1.0, 0.0), "-1", -1.0)
    assert (proof.lower, proof.upper, proof.unique, proof.convexity_shift) == ((1,), (), True, 0.0)
    verify(corner, proof)


def test_an_equality_with_general_rows_solved_by_hand_is_certified() -> None:
    # Nearest point to (1, 2, 3) with sum 1 and x₂ − x₀ ≤ 1: the plane gives (−2/3, 1/3, 4/3), the row then binds.
    problem = Problem(np.eye(3), np.array([-1.0, -2.0, -3.0]), G=np.array([[-1.0, 0.0, 1.0], [1.0, 1.0, 1.0]]),
                      h=np.array([1.0, 5.0]), A=np.ones((1, 3)), b=np.ones(1))
    proof = certify(problem, np.zeros(3))
    assert [str(v) for v in exact_optimum(problem, proof)] == ["-1/6", "1/3", "5/6"]
    assert (proof.rows, proof.equalities) == ((0,), (0,))
    verify(problem, proof)


def test_an_exact_optimum_that_no_double_holds_is_rebuilt_from_the_active_set() -> None:
    problem = Problem(np.array([[3.0]]), np.array([-1.0]), lb=np.zeros(1))
    proof = certify(problem, np.array([0.3]))
    assert [str(v) for v in exact_optimum(problem, proof)] == ["1/3"]
    assert (proof.value, proof.x) == ("-1/6", (1 / 3,))


@settings(max_examples=40, deadline=None)
@given(boxes(), st.lists(st.floats(-10, 10), min_size=4, max_size=4))
def test_a_box_optimum_from_any_start_is_the_best_of_all_active_sets(problem: Problem, start: list[float]) -> None:
    proof = certify(problem, np.array(start[: len(problem.q)]))
    verify(problem, proof)
    x = [Fraction(int(v.p), int(v.q)) for v in exact_optimum(problem, proof)]
    assert Fraction(proof.value) == cost(problem, x) == lowest_cost(problem)
    assert all(lo <= v <= hi for lo, v, hi in zip(fractions(problem.lb), x, fractions(problem.ub), strict=True))


@settings(max_examples=40, deadline=None)
@given(boxes())
def test_unique_says_whether_all_best_active_sets_give_one_point(problem: Problem) -> None:
    proof = certify(problem, np.zeros(len(problem.q)))
    best = {tuple(x) for x in feasible_stationary_points(problem) if cost(problem, x) == Fraction(proof.value)}
    assert proof.unique == (len(best) == 1)  # over a bounded set, two optima have two extreme points


def walled(problem: Problem, size: float) -> Problem:
    """The same problem inside a large box, so that the reference always finds an optimum."""
    lb = np.maximum(problem.lb, -size)
    return Problem(problem.P, problem.q, problem.G, problem.h, problem.A, problem.b, lb, np.full(lb.size, size))


@pytest.mark.parametrize("prime", [exact_linear_algebra.PRIME, 2, 3], ids=["large prime", "2", "3"])
@settings(max_examples=60, deadline=None)
@given(problem=polyhedra(), start=st.lists(st.floats(-10, 10), min_size=3, max_size=3))
def test_general_rows_end_in_the_best_active_set_a_contradiction_or_a_ray(
        prime: int, problem: Problem, start: list[float]) -> None:
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


@settings(max_examples=100, deadline=None)
@given(polyhedra(), st.permutations(range(10)))
def test_criss_cross_alone_ends_where_the_whole_method_ends(problem: Problem, order: list[int]) -> None:
    program, factor = DoubleProblem.of(problem).exact(0.0)
    wanted = [k for k in order[:3] if k < len(program.constraints)]
    try:
        value = certify(problem, np.zeros(len(problem.q))).value
    except (Infeasible, Unbounded):
        with pytest.raises((Infeasible, Unbounded)):
            exact_active_set.criss_cross(program, program.working_set(wanted), Work(WORK))
        return
    _, point = exact_active_set.criss_cross(program, program.working_set(wanted), Work(WORK))
    assert str(program.value(point.x) * factor) == value


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


@pytest.mark.parametrize("d", [18, 60])
@pytest.mark.parametrize("start", ["zeros", "ones", "noise", "huge"])
def test_a_rough_start_still_ends_in_the_same_proof(d: int, start: str) -> None:
    problem = gram_problem(d, seed=d)
    rough = {"zeros": np.zeros(d), "ones": np.ones(d), "noise": np.random.default_rng(0).normal(size=d),
             "huge": np.full(d, 1e300)}[start]
    proof = certify(problem, rough)
    verify(problem, proof)
    assert 0 < len(proof.lower) < d
    assert proof == certify(problem, np.array(proof.x))


def test_the_largest_size_of_the_race_is_certified() -> None:
    problem = gram_problem(140, seed=140)
    proof = certify(problem, np.zeros(140))
    verify(problem, proof)
    assert exact_cost_gap(problem, proof, np.array(proof.x)).absolute >= 0


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


# --- degenerate and singular -----------------------------------------------------------------------------

def test_a_bound_touched_with_zero_multiplier_is_certified_either_way() -> None:
    problem = Problem(np.eye(2), np.array([0.0, -1.0]), lb=np.zeros(2), ub=np.ones(2))
    proof = certify(problem, np.array([0.0, 1.0]))
    assert (proof.x, proof.unique) == ((0.0, 1.0), True)
    for lower in ((), (0,)):
        for upper in ((), (1,)):
            verify(problem, replace(proof, lower=lower, upper=upper))


def test_equal_bounds_and_repeated_rows_are_certified() -> None:
    problem = Problem(np.eye(2), np.array([-1.0, -1.0]), G=np.array([[1.0, 1.0]] * 3), h=np.ones(3),
                      A=np.array([[1.0, -1.0], [2.0, -2.0]]), b=np.zeros(2), lb=np.array([0.5, -INF]),
                      ub=np.array([0.5, INF]))
    proof = certify(problem, np.full(2, 0.5))
    verify(problem, proof)
    assert (proof.x, proof.value, len(proof.equalities)) == ((0.5, 0.5), "-3/4", 1)


def test_a_singular_problem_has_one_value_and_says_that_its_optimum_is_not_unique() -> None:
    problem = Problem(np.ones((2, 2)), np.array([-2.0, -2.0]), lb=np.zeros(2), ub=np.full(2, 3.0))
    proofs = [certify(problem, np.array(x)) for x in ([2.0, 0.0], [0.0, 2.0], [1.0, 1.0])]
    assert {proof.value for proof in proofs} == {"-2"}
    assert not any(proof.unique for proof in proofs)
    for proof in proofs:
        verify(problem, proof)


def test_a_singular_problem_whose_bounds_leave_one_optimum_says_unique() -> None:
    tied = Problem(np.zeros((2, 2)), np.array([1.0, -1.0]), lb=np.zeros(2), ub=np.ones(2))
    assert certify(tied, np.full(2, 0.5)).unique
    # P = 0 and q = 0: all multipliers vanish, and the three rows alone shrink the feasible set to the origin.
    point = Problem(np.zeros((2, 2)), np.zeros(2), G=np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]]), h=np.zeros(3))
    assert certify(point, np.ones(2)).unique
    open_cone = Problem(np.zeros((2, 2)), np.zeros(2), G=point.G[:2], h=np.zeros(2))
    assert not certify(open_cone, np.ones(2)).unique


def test_a_variable_that_nothing_decides_is_pinned_at_zero() -> None:
    problem = Problem(np.diag([1.0, 0.0]), np.array([-1.0, 0.0]))
    proof = certify(problem, np.array([0.0, 7.0]))
    assert (proof.x, proof.pinned, proof.unique) == ((1.0, 0.0), (1,), False)
    verify(problem, proof)


def test_a_column_that_the_drive_never_excited_is_certified() -> None:
    whole = gram_problem(12, seed=3)
    P, q = whole.P.copy(), whole.q.copy()
    P[4], P[:, 4], q[4] = 0, 0, 0
    proof = certify(Problem(P, q, lb=whole.lb, ub=whole.ub), np.zeros(12))
    verify(Problem(P, q, lb=whole.lb, ub=whole.ub), proof)
    assert (proof.convexity_shift, proof.unique) == (0.0, False)


# --- convexity -------------------------------------------------------------------------------------------

def test_a_gram_matrix_made_indefinite_by_rounding_is_shifted_by_the_smallest_power_of_two() -> None:
    a = np.array([1.0, 1 + 2.0**-52, 1 + 2.0**-51])
    P = np.outer(a, a)  # rank one before rounding
    problem = Problem(P, -a, lb=np.zeros(3), ub=np.ones(3))
    assert not is_semidefinite(P, Fraction(0))
    proof = certify(problem, np.zeros(3))
    verify(problem, proof)
    shift = proof.convexity_shift
    assert 0 < shift <= 1e-12 * np.trace(P) / 3
    assert math.frexp(shift)[0] == 0.5
    assert is_semidefinite(P, Fraction(shift))
    assert not is_semidefinite(P, Fraction(shift) / 2)
    for other in (0.0, shift / 2, shift * 2):
        with pytest.raises(NotCertified, match=r"line 2 \(convexity\)"):
            verify(problem, replace(proof, convexity_shift=other))


def test_an_optimum_that_hangs_on_the_shift_is_none_and_one_that_does_not_is_certified() -> None:
    P = np.array([[1.0, 1.0], [1.0, 1.0 - 2.0**-53]])  # its negative curvature is one rounding, along (1, -1)
    with pytest.raises(RoundingDecides, match="indefinite by rounding"):
        certify(Problem(P, np.array([1.0, -1.0])), np.zeros(2))
    for problem in (Problem(P, np.array([-1.0, -1.0])), Problem(P, np.array([1.0, -1.0]), lb=np.full(2, -3.0), ub=np.full(2, 3.0))):
        proof = certify(problem, np.zeros(2))
        assert proof.convexity_shift > 0.0
        verify(problem, proof)


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32), d=st.integers(1, 12), decades=st.floats(0.0, 18.0), spread=st.floats(0.0, 8.0))
def test_what_a_factorisation_in_doubles_calls_definite_is_definite_in_rationals(seed: int, d: int, decades: float, spread: float) -> None:
    rng = np.random.default_rng(seed)
    U, D = np.linalg.qr(rng.normal(size=(d, d)))[0], 10.0 ** rng.uniform(-spread, spread, size=d)
    P = (U * 10.0 ** -np.linspace(0.0, decades, d)) @ U.T * np.outer(D, D)
    P = 0.5 * (P + P.T)
    data = DoubleProblem.of(Problem(P, np.zeros(d)))
    if data._is_plainly_definite():
        assert exact_linear_algebra.semidefinite_rank(data._symmetric[0]) == d
    elif decades < 8.0:  # it recognises what is not near singular
        raise AssertionError(f"condition 1e{decades:.1f} is not recognised")


def is_semidefinite(P: np.ndarray, shift: Fraction) -> bool:
    """All principal minors are nonnegative, in fractions."""
    M = [[v + (shift if i == j else 0) for j, v in enumerate(row)] for i, row in enumerate(fractions(P))]
    subsets = chain.from_iterable(combinations(range(len(M)), k) for k in range(1, len(M) + 1))
    return all(determinant([[M[i][j] for j in rows] for i in rows]) >= 0 for rows in subsets)


def determinant(M: list[list[Fraction]]) -> Fraction:
    if not M:
        return Fraction(1)
    return sum(((-1) ** j * v * determinant([row[:j] + row[j + 1:] for row in M[1:]]) for j, v in enumerate(M[0]) if v),
               Fraction(0))


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 4), st.data())
def test_semidefiniteness_and_rank_agree_with_all_principal_minors(d: int, data: st.DataObject) -> None:
    lower = data.draw(st.lists(st.lists(st.integers(-2, 2), min_size=d, max_size=d), min_size=d, max_size=d))
    P = np.array(lower) + np.array(lower).T if data.draw(st.booleans()) else np.array(lower).T @ np.diag(
        data.draw(st.lists(st.integers(0, 2), min_size=d, max_size=d))) @ np.array(lower)
    rank = exact_linear_algebra.semidefinite_rank([[int(v) for v in row] for row in P])
    assert (rank is not None) == is_semidefinite(P.astype(float), Fraction(0))
    assert rank is None or rank == np.linalg.matrix_rank(P)


@pytest.mark.parametrize("P", [np.diag([1.0, -1e-9]), np.array([[0.0, 1.0], [1.0, 0.0]]), np.diag([-1.0, -1.0])],
                         ids=["slightly", "saddle", "concave"])
def test_a_problem_that_is_not_convex_is_refused(P: np.ndarray) -> None:
    with pytest.raises(NotCertified, match="P is not convex"):
        certify(Problem(P, np.zeros(2), lb=-np.ones(2), ub=np.ones(2)), np.zeros(2))


def test_an_unsymmetric_P_means_its_symmetric_part() -> None:
    skewed = Problem(np.array([[2.0, 1.0], [-1.0, 4.0]]), corner.q, lb=corner.lb, ub=corner.ub)
    assert certify(skewed, np.zeros(2)).value == certify(corner, np.zeros(2)).value


# --- no optimum, bad input -------------------------------------------------------------------------------

def test_an_unbounded_problem_is_refused_with_the_reason() -> None:
    with pytest.raises(Unbounded, match=r"falls without bound .* lower bound of variable 1"):
        certify(Problem(np.diag([1.0, 0.0]), np.array([0.0, -1.0]), lb=np.zeros(2)), np.zeros(2))
    with pytest.raises(Unbounded, match="falls without bound"):
        certify(Problem(np.diag([1.0, 0.0]), np.array([0.0, -1.0])), np.zeros(2))


@pytest.mark.parametrize(("rows", "message"), [
    ({"lb": np.ones(2), "ub": np.zeros(2)}, "(upper|lower) bound of variable 0 against (upper|lower)"),
    ({"G": np.array([[1.0, 1.0], [-1.0, -1.0]]), "h": np.array([0.0, -1.0])}, "inequality row"),
    ({"A": np.ones((2, 2)), "b": np.array([0.0, 1.0])}, "equality row 1 against equality row 0"),
    ({"G": np.zeros((1, 2)), "h": -np.ones(1)}, "its row is zero"),
], ids=["bounds", "rows", "equalities", "zero row"])
@pytest.mark.parametrize("P", [np.eye(2), np.zeros((2, 2))], ids=["strictly convex", "linear"])
def test_an_infeasible_problem_is_refused_with_the_contradiction(P: np.ndarray, rows: dict, message: str) -> None:
    with pytest.raises(Infeasible, match=message):
        certify(Problem(P, np.array([-1.0, 2.0]), **rows), np.zeros(2))


@pytest.mark.parametrize(("name", "value"), [("P", np.nan), ("q", INF), ("lb", np.nan), ("lb", INF), ("ub", -INF),
                                             ("h", np.nan), ("G", INF), ("b", INF)])
def test_nan_and_misplaced_infinities_in_the_data_are_refused_by_name(name: str, value: float) -> None:
    data = {"P": np.eye(2), "q": np.zeros(2), "G": np.ones((1, 2)), "h": np.ones(1), "A": np.array([[1.0, -1.0]]),
            "b": np.zeros(1), "lb": -np.ones(2), "ub": np.ones(2)}
    data[name].flat[-1] = value
    with pytest.raises(ValueError, match=rf"^{name}\[.*\] is -?(nan|inf), and no exact proof starts from that$"):
        certify(Problem(**data), np.zeros(2))


def test_an_answer_that_is_not_finite_or_of_the_wrong_shape_is_refused() -> None:
    proof = certify(corner, np.zeros(2))
    with pytest.raises(ValueError, match=r"x\[1\] is nan"):
        certify(corner, np.array([0.0, np.nan]))
    with pytest.raises(ValueError, match=r"x\[0\] is inf"):
        exact_cost_gap(corner, proof, np.array([INF, 0.0]))
    with pytest.raises(ValueError, match=r"x has shape \(3,\), expected \(2,\)"):
        exact_cost_gap(corner, proof, np.zeros(3))
    with pytest.raises(ValueError, match="the constant term c is nan"):
        exact_cost_gap(corner, proof, np.zeros(2), c=np.nan)


def test_a_proof_that_takes_too_much_work_is_said() -> None:
    with pytest.raises(NotCertified, match=r"no proof within 1e\+04 bit operations of exact arithmetic"):
        certify(gram_problem(18, seed=1), np.zeros(18), work=1e4)


# --- replaying the proof ---------------------------------------------------------------------------------

@pytest.mark.parametrize(("line", "change"), [
    (r"1 \(problem\)", {"problem": "0" * 64}),
    (r"2 \(convexity\)", {"convexity_shift": 2.0**-60}),
    (r"3 \(stationarity\)", {"lower": (1, 1)}),
    (r"3 \(stationarity\)", {"lower": (7,)}),
    (r"3 \(stationarity\)", {"upper": (1,)}),
    (r"4 \(feasibility\)", {"lower": ()}),
    (r"5 \(signs\)", {"lower": (0, 1)}),
    (r"5 \(signs\)", {"pinned": (0,)}),
    (r"6 \(value\)", {"value": "-1000000000000000000000000000001/1000000000000000000000000000000"}),
    (r"7 \(answer\)", {"value_rounded": -1.0000000000000002}),
    (r"7 \(answer\)", {"x": (1.0000000000000002, 0.0)}),
    (r"7 \(answer\)", {"unique": False}),
])
def test_a_perturbed_certificate_fails_at_the_line_that_is_wrong(line: str, change: dict) -> None:
    proof = certify(corner, np.zeros(2))
    with pytest.raises(NotCertified, match=f"proof line {line} fails"):
        verify(corner, replace(proof, **change))


@pytest.mark.parametrize("member", range(18))
def test_moving_any_variable_in_or_out_of_the_active_set_is_noticed(member: int) -> None:
    problem = gram_problem(18, seed=18)
    proof = certify(problem, np.zeros(18))
    with pytest.raises(NotCertified, match=r"proof line [45]"):
        verify(problem, replace(proof, lower=tuple(sorted(set(proof.lower) ^ {member}))))


def test_the_certificate_of_other_data_is_rejected() -> None:
    proof = certify(corner, np.zeros(2))
    nudged = Problem(corner.P, np.nextafter(corner.q, 0), lb=corner.lb, ub=corner.ub)
    with pytest.raises(NotCertified, match="other data"):
        verify(nudged, proof)
    with pytest.raises(NotCertified, match="other data"):
        exact_cost_gap(nudged, proof, np.zeros(2))


def test_json_brings_the_same_certificate_back() -> None:
    rng = np.random.default_rng(5)
    couplings = np.tril(rng.normal(size=(60, 60)), -1) * 2.0**-200  # far below the diagonal: many digits
    P = np.diag(rng.uniform(1, 2, 60)) + couplings + couplings.T
    problem = Problem(P, rng.normal(size=60), lb=np.full(60, -9.0))
    proof = certify(problem, np.zeros(60))
    assert len(proof.value) > 2 * 4300  # longer integers than Python reads by default
    again = Certificate.from_json(proof.to_json())
    assert again == proof
    verify(problem, again)
    assert exact_cost_gap(problem, again, np.array(again.x)).absolute >= 0


@pytest.mark.parametrize("text", ["", "[]", "{}", json.dumps({"x": [1.0]})])
def test_text_that_is_no_certificate_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="not a certificate"):
        Certificate.from_json(text)


# --- the gap ---------------------------------------------------------------------------------------------

def test_the_gap_of_thousands_of_random_points_is_never_negative() -> None:
    problem, rng = gram_problem(6, seed=2), np.random.default_rng(3)
    proof = certify(problem, np.zeros(6))
    scales = 10.0 ** rng.uniform(-20, 3, size=3000)
    gaps = [exact_cost_gap(problem, proof, np.array(proof.x) + s * rng.normal(size=6)) for s in scales]
    assert min(gap.absolute for gap in gaps) >= 0
    assert all(gap.violation >= 0 for gap in gaps)


def test_a_tiny_perturbation_gives_the_square_of_it_where_doubles_would_see_nothing() -> None:
    problem = Problem(np.eye(1), np.array([-1.0]), lb=np.zeros(1))
    proof = certify(problem, np.zeros(1))
    gap = exact_cost_gap(problem, proof, np.array([1 + 2.0**-50]))
    assert gap.absolute == 2.0**-101  # ½ (2⁻⁵⁰)², 4e-31
    assert exact_cost_gap(problem, proof, np.ones(1)).absolute == 0


@settings(max_examples=60, deadline=None)
@given(boxes(), st.lists(st.floats(-1e3, 1e3), min_size=4, max_size=4))
def test_the_gap_on_a_box_is_the_cost_of_the_clipped_point_above_the_optimum(problem: Problem, at: list[float]) -> None:
    x = np.array(at[: len(problem.q)])
    proof = certify(problem, x)
    clipped = np.clip(x, problem.lb, problem.ub)
    gap = exact_cost_gap(problem, proof, x)
    assert gap.absolute == float(cost(problem, fractions(clipped)) - Fraction(proof.value))
    assert gap.violation == float(max(abs(a - b) for a, b in zip(fractions(x), fractions(clipped), strict=True)))


@settings(max_examples=60, deadline=None)
@given(polyhedra(), st.lists(st.floats(-10, 10).map(lambda v: round(v, 2)), min_size=3, max_size=3))
def test_the_gap_with_general_rows_is_that_of_the_exact_projection(problem: Problem, at: list[float]) -> None:
    d = len(problem.q)
    x = np.array(at[:d])
    try:
        proof = certify(problem, x)
    except (Infeasible, Unbounded):
        return
    projection = Problem(np.eye(d), -x, problem.G, problem.h, problem.A, problem.b, problem.lb)
    nearest = min(feasible_stationary_points(projection), key=lambda z: cost(projection, z))
    gap = exact_cost_gap(problem, proof, x)
    assert gap.absolute == float(cost(problem, nearest) - Fraction(proof.value))
    assert gap.violation == float(max(abs(a - b) for a, b in zip(fractions(x), nearest, strict=True)))


def test_the_relative_gap_divides_by_the_cost_with_its_constant() -> None:
    proof = certify(corner, np.zeros(2))  # V* = −1
    at_zero = exact_cost_gap(corner, proof, np.zeros(2), c=5.0)
    assert (at_zero.absolute, at_zero.relative) == (1.0, 0.25)
    assert exact_cost_gap(corner, proof, np.zeros(2)).relative == 1.0
    # V* + c = 0 is a perfect fit: the rounding of c stands in for it.
    assert exact_cost_gap(corner, proof, np.zeros(2), c=1.0).relative == 2.0**52
    assert exact_cost_gap(corner, proof, np.array([1.0, 0.0]), c=1.0).relative == 0


def test_a_ratio_beyond_the_largest_double_is_infinite() -> None:
    still = Problem(np.eye(1), np.zeros(1))
    assert exact_cost_gap(still, certify(still, np.ones(1)), np.array([4.0])).relative == INF
    assert exact_linear_algebra.nearest_double(-exact_linear_algebra.power_of_two(1024)) == -INF


def test_a_value_that_is_too_high_is_disproved_by_a_better_point() -> None:
    proof = replace(certify(corner, np.zeros(2)), value="-1/2", value_rounded=-0.5)
    with pytest.raises(NotCertified, match=r"a feasible point costs 0.5 less than the certified optimum"):
        exact_cost_gap(corner, proof, np.array([1.0, 0.0]))
