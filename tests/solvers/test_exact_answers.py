"""What "found" promises of the exact solver, judged in rational arithmetic: a relative cost gap of at most 1e-9,
whatever the scale of P and q, with zero and equal rows, curvatures down to rounding, and every kind of bound."""

import numpy as np
import pytest
from box_programs import INF, Array, gap, inside, random_program, seeds
from hypothesis import example, given, settings
from hypothesis import strategies as st
from qpsolvers import Problem

from solvers import get
from solvers.certificate import NotCertified, certify
from solvers.protocol import Solver

Program = tuple[Array, Array, Array, Array]


def hard_program(seed: int) -> Program:
    """P, q, lb, ub of 1 to 9 variables with zero or nearly equal rows and finite, 1e20 or no bounds."""
    rng = np.random.default_rng(seed)
    d = int(rng.integers(1, 10))
    A = np.round(rng.normal(size=(d + 2, d)), 1)
    if rng.random() < 0.5:
        apart = (rng.random() < 0.7) * 10 ** rng.uniform(-8, 0) * rng.normal(size=d + 2)
        A[:, rng.integers(d)] = A[:, 0] * (1 + apart)
    A[:, rng.random(d) < 0.15] = 0
    P = A.T @ A
    i, j = rng.integers(d, size=2)
    if i != j and rng.random() < 0.3:  # the curvature along one direction is weak
        P[[i, j]], P[:, [i, j]] = 0, 0
        P[i, i] = P[j, j] = 1
        P[i, j] = P[j, i] = 1 - 10 ** rng.uniform(-15.5, -1)
    q = -P @ rng.normal(size=d) if rng.random() < 0.5 else rng.normal(size=d)
    lb = np.where(rng.random(d) < 0.6, np.round(rng.normal(size=d), 1), rng.choice([-INF, -1e20], d))
    above = np.maximum(lb, 0) + np.round(np.abs(rng.normal(size=d)), 1)
    ub = np.where(rng.random(d) < 0.6, above, rng.choice([INF, 1e20], d))
    ub = np.where((rng.random(d) < 0.1) & (lb > -1e19), lb, np.maximum(lb, ub))
    scale = 2.0 ** rng.integers(-12, 13, d) if rng.random() < 0.5 else np.ones(d)
    return P * np.outer(scale, scale), q * scale, lb / scale, ub / scale


def solver(program: Program, **settings_: object) -> Solver:
    P, q, lb, ub = program
    s = get("box_active_set", **settings_)
    s.setup(Problem(P, q, lb=lb, ub=ub))
    return s


def solved(s: Solver) -> Array | str:
    """The answer, or the sentence of the refusal."""
    try:
        return s.solve().copy()
    except ValueError as refusal:
        return str(refusal)


def relative_gap(program: Program, x: Array) -> float:
    P, q, lb, ub = program
    assert inside(x, lb, ub)
    return gap(Problem(P, q, lb=lb, ub=ub), x)


@pytest.mark.parametrize(
    "which", [range(500), pytest.param(range(500, 10_500), marks=pytest.mark.nightly)], ids=["few", "many"]
)
def test_a_found_answer_costs_at_most_1e_9_more_than_the_optimum_and_few_programs_with_an_optimum_are_refused(
    which: range,
) -> None:
    found = refused = 0
    for program in map(hard_program, which):
        P, q, lb, ub = program
        x = solved(solver(program))
        try:
            certify(Problem((P + P.T) / 2, q, lb=lb, ub=ub), np.clip(np.zeros(q.size), lb, ub))
        except NotCertified:
            continue
        if isinstance(x, str):
            refused += 1
        else:
            assert relative_gap(program, x) <= 1e-9
            found += 1
    assert refused <= 0.01 * found


@pytest.mark.parametrize("curvature", [1e-3, 1e-9, 5e-12, 1e-12, 3e-13, 1e-14])
def test_a_curvature_far_below_one_does_not_spoil_the_cost(curvature: float) -> None:
    program = (
        np.array([[1.0, 1.0 - curvature], [1.0 - curvature, 1.0]]),
        np.array([1.0, -1.0]),
        np.full(2, -INF),
        np.full(2, INF),
    )
    s = solver(program)
    assert relative_gap(program, s.solve()) <= 1e-18
    assert s.solution().found


@settings(max_examples=200, deadline=None)
@given(seed=seeds, of_P=st.integers(-400, 400), of_x=st.integers(-400, 400), hard=st.booleans())
@example(seed=0, of_P=1, of_x=0, hard=False)
@example(seed=0, of_P=0, of_x=512, hard=False)
@example(seed=0, of_P=0, of_x=-531, hard=False)
def test_powers_of_two_times_the_data_change_no_bit_of_the_answer(seed: int, of_P: int, of_x: int, hard: bool) -> None:
    P, q, lb, ub = hard_program(seed) if hard else random_program(seed, 6, 4)
    x = solved(solver((P, q, lb, ub)))
    scaled = (np.ldexp(P, of_P), np.ldexp(q, of_P + of_x), np.ldexp(lb, of_x), np.ldexp(ub, of_x))
    y = solved(solver(scaled))
    assert y == x if isinstance(x, str) else np.array_equal(y, np.ldexp(x, of_x))


def test_a_variable_whose_row_of_P_is_zero_goes_to_the_bound_that_q_points_to() -> None:
    P, bounds = 1e-15 * np.diag([0.0, 1.0]), (np.array([2.0, 0.0]), np.array([4.0, 1.0]))
    s = solver((P, 1e-15 * np.array([-7.0, 7.0]), *bounds))
    assert s.solve().tolist() == [4.0, 0.0]
    s.update(q=np.array([7.0, -7.0]))
    assert s.solve().tolist() == [2.0, 1.0]
    s.update(q=np.zeros(2))
    assert s.solve(np.array([3.0, 1.0])).tolist() == [3.0, 0.0]
    s = solver((P, np.array([-7.0, 7.0]), *bounds[:1], np.full(2, INF)))
    with pytest.raises(ValueError, match="unbounded"):
        s.solve()


@settings(max_examples=60, deadline=None)
@given(seed=seeds, other=seeds)
def test_a_cold_answer_does_not_depend_on_a_singular_or_refused_program_before(seed: int, other: int) -> None:
    P, q, lb, ub = hard_program(seed)
    rng = np.random.default_rng(other)
    s = solver((P, q, lb, ub))
    first = solved(s)
    s.update(q=1e6 * rng.normal(size=q.size))
    solved(s)
    with pytest.raises(ValueError, match="finite"):
        s.update(q=np.full(q.size, np.nan))
    with pytest.raises(ValueError, match="not ready"):
        s.solve()
    s.update(q=q)
    again = solved(s)
    assert again == first if isinstance(first, str) else np.array_equal(again, first)


@settings(max_examples=60, deadline=None)
@given(seed=seeds, cap=st.integers(1, 3))
def test_a_cap_of_exchanges_holds_for_singular_programs_too(seed: int, cap: int) -> None:
    P, q, lb, ub = hard_program(seed)
    s = solver((P, q, lb, ub), most_exchanges=cap)
    if isinstance(x := solved(s), str):
        return
    assert s.solution().extras["exchanges"] <= cap
    assert inside(x, lb, ub)
