"""The certificate of an optimum against an independent reference, every active set in fractions: the proof, its
replay, exact convexity, and the exact cost of an answer above the optimum."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import chain, combinations, product

import numpy as np
import pytest
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
    rational,
)
from flint import fmpq
from hypothesis import given, settings
from hypothesis import strategies as st
from qpsolvers import Problem
from scipy.sparse import csc_matrix

from solvers.certificate import (
    Certificate,
    Infeasible,
    NotCertified,
    RoundingDecides,
    Unbounded,
    certify,
    exact_cost_gap,
    verify,
)
from solvers.certificate_document import document
from solvers.exact import linear_algebra as exact_linear_algebra
from solvers.exact.problem import DoubleProblem, Kind

I2, ZERO2 = np.eye(2), np.zeros((2, 2))
BY_HAND: dict[str, tuple[Problem, dict[str, object]]] = {
    # Nearest point to (1, 2, 3) with sum 1 and x₂ − x₀ ≤ 1: the plane gives (−2/3, 1/3, 4/3), the row then binds.
    "an equality and general rows": (
        Problem(
            np.eye(3),
            np.array([-1.0, -2.0, -3.0]),
            G=np.array([[-1.0, 0.0, 1.0], [1.0, 1.0, 1.0]]),
            h=np.array([1.0, 5.0]),
            A=np.ones((1, 3)),
            b=np.ones(1),
        ),
        {"rows": (0,), "equalities": (0,), "x": (-1 / 6, 1 / 3, 5 / 6)},
    ),
    "extreme magnitudes": (
        Problem(np.diag([1e-300, 1e300]), np.array([-1e-300, -3e300]), lb=np.zeros(2), ub=np.array([5e-324, 2.0])),
        {"x": (5e-324, 2.0), "upper": (0, 1)},
    ),
    "equal bounds and repeated rows": (
        Problem(
            I2,
            np.array([-1.0, -1.0]),
            G=np.array([[1.0, 1.0]] * 3),
            h=np.ones(3),
            A=np.array([[1.0, -1.0], [2.0, -2.0]]),
            b=np.zeros(2),
            lb=np.array([0.5, -INF]),
            ub=np.array([0.5, INF]),
        ),
        {"x": (0.5, 0.5), "value": "-3/4", "equalities": (0,)},
    ),
    "a linear program with one corner": (
        Problem(ZERO2, np.array([1.0, -1.0]), lb=np.zeros(2), ub=np.ones(2)),
        {"unique": True},
    ),
    # P = 0 and q = 0: all multipliers vanish, and the three rows alone shrink the feasible set to the origin.
    "a single feasible point": (
        Problem(ZERO2, np.zeros(2), G=np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]]), h=np.zeros(3)),
        {"unique": True},
    ),
    "an open cone": (Problem(ZERO2, np.zeros(2), G=I2, h=np.zeros(2)), {"unique": False}),
    "an undetermined variable": (
        Problem(np.diag([1.0, 0.0]), np.array([-1.0, 0.0])),
        {"x": (1.0, 0.0), "pinned": (1,), "unique": False},
    ),
    "an unsymmetric P, which means its symmetric part": (
        Problem(np.array([[2.0, 1.0], [-1.0, 4.0]]), corner.q, lb=corner.lb, ub=corner.ub),
        {"x": (1.0, 0.0), "value": "-1"},
    ),
    "sparse matrices": (
        Problem(csc_matrix(corner.P), corner.q, csc_matrix(np.ones((1, 2))), np.full(1, 0.5), lb=corner.lb),
        {"x": (0.5, 0.0), "value": "-3/4", "rows": (0,), "lower": (1,), "unique": True},
    ),
}


@pytest.mark.parametrize("what", BY_HAND)
def test_an_optimum_found_by_hand_is_certified(what: str) -> None:
    problem, expected = BY_HAND[what]
    proof = certify(problem, np.ones(len(problem.q)))
    verify(problem, proof)
    assert {name: getattr(proof, name) for name in expected} == expected


def nearest_to(x: np.ndarray, problem: Problem) -> Problem:
    """The projection of x onto the constraints of a problem."""
    return Problem(np.eye(x.size), -x, problem.G, problem.h, problem.A, problem.b, problem.lb, problem.ub)


def walled(problem: Problem, size: float) -> Problem:
    """The same problem inside a large box, so that the reference always finds an optimum."""
    lb, ub = np.maximum(problem.lb, -size), np.full(problem.lb.size, size) if problem.ub is None else problem.ub
    return Problem(problem.P, problem.q, problem.G, problem.h, problem.A, problem.b, lb, ub)


@pytest.mark.parametrize("prime", [exact_linear_algebra.PRIME, 2, 3], ids=["large prime", "2", "3"])
@settings(max_examples=60, deadline=None)
@given(problem=st.one_of(boxes(), polyhedra()), start=st.lists(st.floats(-10, 10), min_size=4, max_size=4))
def test_a_program_ends_in_the_best_active_set_which_is_unique_if_no_other_is_as_good_a_contradiction_or_a_ray(
    prime: int, problem: Problem, start: list[float]
) -> None:
    d = len(problem.q)
    try:
        with pytest.MonkeyPatch.context() as patch:  # small primes choose bad working sets, which may cost pivots only
            patch.setattr(exact_linear_algebra, "PRIME", prime)
            proof = certify(problem, np.array(start[:d]))
    except Infeasible:
        assert lowest_cost(nearest_to(np.zeros(d), problem)) is None
        return
    except Unbounded:
        near, far = (lowest_cost(walled(problem, size)) for size in (1e6, 1e9))
        assert far < near - 10**5
        return
    verify(problem, proof)
    x = [Fraction(v) for v in document(problem, proof)["optimum"]["x"]]
    inequalities, equalities = constraint_rows(problem)
    assert all(dot(a, x) <= b for a, b in inequalities)
    assert all(dot(a, x) == b for a, b in equalities)
    assert max(map(abs, x)) < 1e6
    points = list(feasible_stationary_points(walled(problem, 1e6)))
    assert Fraction(proof.value) == cost(problem, x) == min(cost(problem, z) for z in points)
    assert proof.unique == (len({tuple(z) for z in points if cost(problem, z) == Fraction(proof.value)}) == 1)


def among_rows(rank: int) -> Problem:
    """A program of 18 variables between bounds and rows, with a P of this rank."""
    rng = np.random.default_rng(rank)
    factor = rng.integers(-8, 9, size=(rank, 18)).astype(float)
    inside = rng.normal(size=18)
    G, A = rng.normal(size=(10, 18)), rng.normal(size=(2, 18))
    q = rng.integers(-9, 10, size=18).astype(float)
    return Problem(factor.T @ factor, q, G, G @ inside + 0.1, A, A @ inside, inside - 1, inside + 1)


@pytest.mark.parametrize("problem", [*(gram_problem(d, seed=d) for d in (18, 60, 140)), *map(among_rows, (18, 9, 0))])
def test_a_rough_start_still_ends_in_the_same_proof_or_with_several_optima_in_the_same_value(problem: Problem) -> None:
    d, rng = len(problem.q), np.random.default_rng(0)
    starts = np.zeros(d), np.ones(d), rng.normal(size=d), 100.0 * rng.normal(size=d), np.full(d, 1e300)
    first, *others = proofs = [certify(problem, start) for start in starts]
    others.append(certify(problem, np.array(first.x)))
    for proof in proofs:
        verify(problem, proof)
    assert {proof if first.unique else proof.value for proof in others} == {first if first.unique else first.value}
    assert 0 < len(first.lower) < d
    assert exact_cost_gap(problem, first, np.array(first.x)).absolute >= 0


def test_a_bound_touched_with_zero_multiplier_is_certified_either_way() -> None:
    problem = Problem(np.eye(2), np.array([0.0, -1.0]), lb=np.zeros(2), ub=np.ones(2))
    proof = certify(problem, np.array([0.0, 1.0]))
    assert (proof.x, proof.unique) == ((0.0, 1.0), True)
    for lower, upper in product(((), (0,)), ((), (1,))):
        verify(problem, replace(proof, lower=lower, upper=upper))


HELD = Problem(
    I2, np.array([-3.0, -2.0]), np.ones((1, 2)), np.full(1, 2.0), lb=np.array([-9.0, 0.75]), ub=np.array([1.0, INF])
)


@pytest.mark.parametrize(
    ("problem", "start", "active"),
    [
        pytest.param(
            Problem(ZERO2, np.zeros(2), lb=np.zeros(2)),
            np.zeros(2),
            [(Kind.LOWER, 0), (Kind.LOWER, 1)],
            id="no gradient and no curvature",
        ),
        pytest.param(HELD, np.ones(2), [(Kind.UPPER, 0), (Kind.ROW, 0)], id="x_1 alone is free, the multiplier is 1"),
    ],
)
def test_the_active_set_of_a_start_at_its_bounds_and_rows_is_guessed(
    problem: Problem, start: np.ndarray, active: list[tuple[Kind, int]]
) -> None:
    assert DoubleProblem(problem).guess(start) == active


INFEASIBLE: list[tuple[dict[str, np.ndarray], str]] = [
    ({"lb": np.ones(2), "ub": np.zeros(2)}, "(upper|lower) bound of variable 0 against (upper|lower)"),
    ({"G": np.array([[1.0, 1.0], [-1.0, -1.0]]), "h": np.array([0.0, -1.0])}, "inequality row"),
    ({"A": np.ones((2, 2)), "b": np.array([0.0, 1.0])}, "equality row 1 against equality row 0"),
    ({"G": np.zeros((1, 2)), "h": -np.ones(1)}, "its row is zero"),
]
FALLING, BOXED = (np.diag([1.0, 0.0]), np.array([0.0, -1.0])), {"lb": -np.ones(2), "ub": np.ones(2)}


@pytest.mark.parametrize(
    ("problem", "error", "sentence"),
    [
        *(
            (Problem(P, np.array([-1.0, 2.0]), **rows), Infeasible, why)
            for P in (I2, ZERO2)
            for rows, why in INFEASIBLE
        ),
        (Problem(*FALLING, lb=np.zeros(2)), Unbounded, r"falls without bound .* lower bound of variable 1"),
        (Problem(*FALLING), Unbounded, "falls without bound"),
        *(
            (Problem(np.array(P), np.zeros(2), **BOXED), NotCertified, "P is not convex")
            for P in ([[1.0, 0.0], [0.0, -1e-9]], [[0.0, 1.0], [1.0, 0.0]], [[-1.0, 0.0], [0.0, -1.0]])
        ),
    ],
)
def test_a_problem_without_an_optimum_is_refused_with_the_reason(
    problem: Problem, error: type[Exception], sentence: str
) -> None:
    with pytest.raises(error, match=sentence):
        certify(problem, np.zeros(2))


@pytest.mark.parametrize(
    ("name", "value"),
    [("P", np.nan), ("q", INF), ("lb", np.nan), ("lb", INF), ("ub", -INF), ("h", np.nan), ("G", INF), ("b", INF)],
)
def test_nan_and_misplaced_infinities_in_the_data_are_refused_by_name(name: str, value: float) -> None:
    rows = np.ones((1, 2)), np.ones(1), np.array([[1.0, -1.0]]), np.zeros(1)
    problem = Problem(np.eye(2), np.zeros(2), *rows, -np.ones(2), np.ones(2))
    getattr(problem, name).flat[-1] = value
    with pytest.raises(ValueError, match=rf"^{name}\[.*\] must be finite, not -?(nan|inf)$"):
        certify(problem, np.zeros(2))


@pytest.mark.parametrize(
    ("x", "c", "sentence"),
    [
        (np.array([0.0, np.nan]), 0.0, r"x\[1\] must be finite, not nan"),
        (np.array([INF, 0.0]), 0.0, r"x\[0\] must be finite, not inf"),
        (np.zeros(3), 0.0, r"x: expected shape \(2,\), got \(3,\)"),
        (np.zeros(2), np.nan, "the constant term c must be finite, not nan"),
    ],
)
def test_an_answer_that_is_not_finite_or_of_the_wrong_shape_is_refused(x: np.ndarray, c: float, sentence: str) -> None:
    proof = certify(corner, np.zeros(2))
    for call in (lambda: exact_cost_gap(corner, proof, x, c=c), *([lambda: certify(corner, x)] * (c == 0.0))):
        with pytest.raises(ValueError, match=sentence):
            call()


def test_an_optimum_is_proven_even_if_its_uniqueness_takes_too_much_work_and_refused_if_it_does_itself() -> None:
    problem = many_weak_rows()
    proof, decided = (certify(problem, np.zeros(8), work=work) for work in (1e6, 1e7))
    assert (proof, decided.unique) == (replace(decided, unique=None), True)
    for known in (proof, decided):
        verify(problem, known)
    with pytest.raises(NotCertified, match="line 7"):
        verify(problem, replace(proof, unique=False))
    assert Certificate.from_json(proof.to_json()) == proof
    assert exact_cost_gap(problem, proof, np.zeros(8), c=1.0).relative == 0.0
    with pytest.raises(NotCertified, match=r"no proof within 1e\+05 bit operations of exact arithmetic"):
        certify(problem, np.zeros(8), work=1e5)


def test_a_gram_matrix_made_indefinite_by_rounding_is_shifted_by_the_smallest_power_of_two() -> None:
    a = np.array([1.0, 1 + 2.0**-52, 1 + 2.0**-51])
    P = np.outer(a, a)  # rank one before rounding
    problem = Problem(P, -a, lb=np.zeros(3), ub=np.ones(3))
    proof = certify(problem, np.zeros(3))
    verify(problem, proof)
    shift = proof.convexity_shift
    assert 0 < shift <= 1e-12 * np.trace(P) / 3
    assert math.frexp(shift)[0] == 0.5
    assert [is_semidefinite(P, Fraction(shift) * part) for part in (0, Fraction(1, 2), 1)] == [False, False, True]
    for other in (0.0, shift / 2, shift * 2):
        with pytest.raises(NotCertified, match=r"line 2 \(convexity\)"):
            verify(problem, replace(proof, convexity_shift=other))


def test_an_optimum_that_depends_on_the_shift_is_refused_and_others_are_certified() -> None:
    P = np.array([[1.0, 1.0], [1.0, 1.0 - 2.0**-53]])  # its negative curvature is one rounding, along (1, -1)
    with pytest.raises(RoundingDecides, match="indefinite by rounding"):
        certify(Problem(P, np.array([1.0, -1.0])), np.zeros(2))
    for problem in (
        Problem(P, np.array([-1.0, -1.0])),
        Problem(P, np.array([1.0, -1.0]), lb=np.full(2, -3.0), ub=np.full(2, 3.0)),
    ):
        proof = certify(problem, np.zeros(2))
        assert proof.convexity_shift > 0.0
        verify(problem, proof)


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32), d=st.integers(1, 12), decades=st.floats(0.0, 18.0), spread=st.floats(0.0, 8.0))
def test_a_matrix_that_a_factorisation_in_doubles_proves_definite_is_definite_in_rationals(
    seed: int, d: int, decades: float, spread: float
) -> None:
    rng = np.random.default_rng(seed)
    U, D = np.linalg.qr(rng.normal(size=(d, d)))[0], 10.0 ** rng.uniform(-spread, spread, size=d)
    P = (U * 10.0 ** -np.linspace(0.0, decades, d)) @ U.T * np.outer(D, D)
    P = 0.5 * (P + P.T)
    data = DoubleProblem(Problem(P, np.zeros(d)))
    if data._is_plainly_definite():
        assert exact_linear_algebra.semidefinite_rank(data._symmetric[0]) == d
    elif decades < 8.0:  # it recognises matrices that are not nearly singular
        raise AssertionError(f"condition 1e{decades:.1f} is not recognised")


def is_semidefinite(P: np.ndarray, shift: Fraction) -> bool:
    """All principal minors are nonnegative, in fractions."""
    M = [[v + (shift if i == j else 0) for j, v in enumerate(row)] for i, row in enumerate(fractions(P))]
    subsets = chain.from_iterable(combinations(range(len(M)), k) for k in range(1, len(M) + 1))
    return all(rational([[M[i][j] for j in rows] for i in rows]).det() >= 0 for rows in subsets)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 4), st.data())
def test_semidefiniteness_and_rank_agree_with_all_principal_minors(d: int, data: st.DataObject) -> None:
    lower = data.draw(st.lists(st.lists(st.integers(-2, 2), min_size=d, max_size=d), min_size=d, max_size=d))
    P = (
        np.array(lower) + np.array(lower).T
        if data.draw(st.booleans())
        else np.array(lower).T
        @ np.diag(data.draw(st.lists(st.integers(0, 2), min_size=d, max_size=d)))
        @ np.array(lower)
    )
    rank = exact_linear_algebra.semidefinite_rank([[int(v) for v in row] for row in P])
    assert (rank is not None) == is_semidefinite(P.astype(float), Fraction(0))
    assert rank is None or rank == np.linalg.matrix_rank(P)


@pytest.mark.parametrize(
    ("line", "change"),
    [
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
    ],
)
def test_a_perturbed_certificate_fails_at_the_line_that_is_wrong(line: str, change: dict) -> None:
    proof = certify(corner, np.zeros(2))
    with pytest.raises(NotCertified, match=f"proof line {line} fails"):
        verify(corner, replace(proof, **change))


@pytest.mark.parametrize("used", [verify, partial(exact_cost_gap, x=np.zeros(2))], ids=["verify", "exact_cost_gap"])
@pytest.mark.parametrize(
    ("P", "q"),
    [
        pytest.param(corner.P, np.nextafter(corner.q, 0), id="q"),
        pytest.param(corner.P + np.diag([0.0, 2**-50]), corner.q, id="P"),
    ],
)
def test_the_certificate_fails_for_data_that_differ_in_one_bit(
    used: Callable[[Problem, Certificate], object], P: np.ndarray, q: np.ndarray
) -> None:
    proof = certify(corner, np.zeros(2))
    with pytest.raises(NotCertified, match="other data"):
        used(Problem(P, q, lb=corner.lb, ub=corner.ub), proof)


def test_a_certificate_survives_the_round_trip_through_json() -> None:
    rng = np.random.default_rng(5)
    couplings = np.tril(rng.normal(size=(60, 60)), -1) * 2.0**-200  # far below the diagonal: many digits
    P = np.diag(rng.uniform(1, 2, 60)) + couplings + couplings.T
    problem = Problem(P, rng.normal(size=60), lb=np.full(60, -9.0))
    proof = certify(problem, np.zeros(60))
    assert len(proof.value) > 2 * 4300  # longer integers than Python reads by default
    assert Certificate.from_json(proof.to_json()) == proof
    verify(problem, proof)
    assert exact_cost_gap(problem, proof, np.array(proof.x)).absolute >= 0


@pytest.mark.parametrize("text", ["", "[]", "{}", json.dumps({"x": [1.0]})])
def test_text_that_is_no_certificate_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="not a certificate"):
        Certificate.from_json(text)


@settings(max_examples=120, deadline=None)
@given(st.one_of(boxes(), polyhedra()), st.lists(st.floats(-10, 10).map(lambda v: round(v, 2)), min_size=4, max_size=4))
def test_the_gap_is_the_cost_of_the_exact_projection_above_the_optimum(problem: Problem, at: list[float]) -> None:
    x = np.array(at[: len(problem.q)])
    try:
        proof = certify(problem, x)
    except (Infeasible, Unbounded):
        return
    projection = nearest_to(x, problem)
    nearest = min(feasible_stationary_points(projection), key=lambda z: cost(projection, z))
    gap = exact_cost_gap(problem, proof, x)
    assert gap.absolute == float(cost(problem, nearest) - Fraction(proof.value))
    assert gap.violation == float(max(abs(a - b) for a, b in zip(fractions(x), nearest, strict=True)))


def test_the_relative_gap_divides_by_the_cost_with_its_constant() -> None:
    proof = certify(corner, np.zeros(2))  # V* = −1
    assert exact_cost_gap(corner, proof, np.zeros(2), c=5.0).absolute == 1.0
    # V* + c = 0 is a perfect fit: the rounding of c stands in for it.
    relative = {(0.0, 5.0): 0.25, (0.0, 0.0): 1.0, (0.0, 1.0): 2**52, (1.0, 1.0): 0}
    found = {(x, c): exact_cost_gap(corner, proof, np.array([x, 0.0]), c=c).relative for x, c in relative}
    assert found == relative


def test_a_ratio_beyond_the_largest_double_is_infinite() -> None:
    still = Problem(np.eye(1), np.zeros(1))
    assert exact_cost_gap(still, certify(still, np.ones(1)), np.array([4.0])).relative == INF
    assert exact_linear_algebra.nearest_double(-(fmpq(2) ** 1024)) == -INF


def test_a_value_that_is_too_high_is_disproved_by_a_better_point() -> None:
    proof = replace(certify(corner, np.zeros(2)), value="-1/2", value_rounded=-0.5)
    with pytest.raises(NotCertified, match=r"a feasible point costs 0.5 less than the certified optimum"):
        exact_cost_gap(corner, proof, np.array([1.0, 0.0]))
