"""The exact box solver against rational arithmetic, and the rules it states for hard problems."""

import numpy as np
import pytest
from box_programs import INF, gap, inside, random_bounds, random_program, seeds, spectrum_matrix
from hypothesis import example, given, settings
from hypothesis import strategies as st
from qpsolvers import Problem

from solvers import get

EPS = np.finfo(float).eps
quick = settings(max_examples=60, deadline=None)


def relative_gap(P, q, lb, ub, x):
    """(f(x) − f*) / max(|f*|, 1e-3 |q|ᵀ|x|), every sum exact, of an answer within its bounds."""
    assert inside(x, lb, ub)
    return gap(Problem(P, q, lb=lb, ub=ub), x, max(1e-3 * float(np.abs(q) @ np.abs(x)), 1e-300))


def solver(P, q, lb, ub, **settings_):
    s = get("box_active_set", **settings_)
    s.setup(Problem(P, q, lb=lb, ub=ub))
    return s


def answer(P, q, lb, ub):
    """The answer to a problem that is not singular."""
    s = solver(P, q, lb, ub)
    x = s.solve()
    assert not s.solution().extras["regularised"]
    return x


def residual(P, q, lb, ub, x):
    """Largest violation of the optimality conditions, relative to the data."""
    g = P @ x + q
    wrong = np.where(lb == ub, 0, np.where(x <= lb, np.minimum(g, 0), np.where(x >= ub, np.maximum(g, 0), g)))
    return np.abs(wrong).max() / max(np.abs(q).max(), np.abs(x).max())


@settings(max_examples=120, deadline=None)
@given(seed=seeds, d=st.integers(1, 20), decades=st.floats(0, 12))
def test_it_ends_at_the_exact_optimum_and_at_condition_numbers_up_to_1e12_within_1e_12_of_its_cost(seed, d, decades):
    P, q, lb, ub = random_program(seed, d, decades)
    assert relative_gap(P, q, lb, ub, solver(P, q, lb, ub).solve()) < (1e-18 if decades <= 7 else 1e-12)


def hard_program(kind, rng, d):
    """Badly scaled variables, ties and zero multipliers on integer data, or equal variables that violate equally."""
    P, (lb, ub), q = spectrum_matrix(rng, d, 3), random_bounds(rng, d), rng.normal(size=d)
    match kind:
        case "badly scaled":
            scale = 10 ** rng.uniform(-6, 6, d)
            return P * np.outer(scale, scale), q * scale, lb / scale, ub / scale
        case "integers":
            A, lb, ub = rng.integers(-2, 3, (d, d)), np.round(lb), np.round(ub)
            P = (A @ A.T + np.eye(d)).astype(float)
            return P, -P @ np.clip(np.round(q), lb, ub), lb, ub
    return np.kron(np.eye(3), P), np.tile(q, 3), np.tile(lb, 3), np.tile(ub, 3)


@pytest.mark.parametrize("kind", ["badly scaled", "integers", "copies"])
@quick
@given(seed=seeds, d=st.integers(1, 9))
def test_scales_ties_and_copies_do_not_change_the_exactness(kind, seed, d):
    P, q, lb, ub = hard_program(kind, np.random.default_rng(seed), d)
    x = answer(P, q, lb, ub)
    for part in np.split(np.arange(x.size), 3 if kind == "copies" else 1):
        assert relative_gap(P[np.ix_(part, part)], q[part], lb[part], ub[part], x[part]) < 1e-18


@quick
@given(seed=seeds, d=st.integers(1, 20))
def test_a_singular_problem_with_a_minimum_is_solved_to_its_cost(seed, d):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(d, int(rng.integers(0, d))))
    P, at = A @ A.T, rng.normal(size=d)
    lb = np.where(rng.random(d) < 0.6, at - rng.random(d), -INF)
    ub = np.where(rng.random(d) < 0.6, at + rng.random(d), INF)
    q = -P @ at
    s = solver(P, q, lb, ub)
    x = s.solve()
    assert inside(x, lb, ub)
    assert s.solution().extras["regularised"]
    gap = 0.5 * (x - at) @ P @ (x - at)  # q = −P at, so at is a minimum and this is f(x) − f(at), x − at taken exactly
    assert gap <= 1e-12 * (0.5 * at @ P @ at + 1e-3)


@quick
@given(seed=seeds, d=st.integers(2, 20))
def test_a_problem_without_a_minimum_is_refused_as_unbounded(seed, d):
    rng = np.random.default_rng(seed)
    rank = int(rng.integers(0, d))
    A = rng.normal(size=(d, rank))
    v = (np.linalg.svd(A)[0][:, rank:] if rank else np.eye(d)) @ rng.normal(size=d - rank)
    q = -A @ A.T @ rng.normal(size=d) - v / np.linalg.norm(v)
    with pytest.raises(ValueError, match="unbounded"):
        solver(A @ A.T, q, np.where(v > 0, -1.0, -INF), np.where(v < 0, 1.0, INF)).solve()


@pytest.mark.parametrize("seed", range(10))
def test_sixty_variables_at_a_condition_number_of_1e11_end_without_cycling(seed):
    rng = np.random.default_rng(seed)
    P, d = spectrum_matrix(rng, 60, 11), 60
    q, lb = -P @ rng.normal(size=d) + 10 ** rng.uniform(-8, 0) * rng.normal(size=d), np.full(d, -0.1)
    s = solver(P, q, lb, None)
    x, extras = s.solve(), s.solution().extras
    assert extras["exchanges"] + extras["refinements"] < 5 * d
    assert residual(P, q, lb, np.full(d, INF), x) < 100 * d * EPS


def test_free_fixed_and_two_sided_variables_alone_have_their_plain_answers():
    rng = np.random.default_rng(11)
    P, q, free = spectrum_matrix(rng, 10, 3), rng.normal(size=10), np.full(10, INF)
    np.testing.assert_allclose(answer(P, q, -free, free), np.linalg.solve(P, -q), rtol=1e-11)
    fixed = rng.normal(size=10)
    assert (answer(P, q, fixed, fixed) == fixed).all()
    np.testing.assert_allclose(
        answer(np.diag(np.diag(P)), q, -0.1 - 0 * q, 0.1 + 0 * q), np.clip(-q / np.diag(P), -0.1, 0.1), rtol=1e-14
    )


def test_a_linear_program_in_a_far_box_ends_at_its_corner():
    s = solver(np.zeros((3, 3)), np.array([-1.0, 2.0, 1e-3]), np.full(3, -1e6), np.full(3, 1e6))
    assert s.solve().tolist() == [1e6, -1e6, -1e6]


def test_directions_that_P_does_not_see_stay_at_the_warm_start_or_go_to_zero():
    P = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    s = solver(P, np.array([-2.0, -2.0, 0.0]), np.full(3, -INF), np.full(3, INF))
    np.testing.assert_allclose(s.solve(), [1.0, 1.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(s.solve(np.array([3.0, 0.0, 7.0])), [2.5, -0.5, 7.0], atol=1e-4)


@quick
@given(seed=seeds, d=st.integers(2, 20), bad=st.sampled_from([np.nan, INF, -INF]), mirrored=st.booleans())
def test_one_entry_of_P_that_is_not_finite_is_found_wherever_it_stands(seed, d, bad, mirrored):
    rng = np.random.default_rng(seed)
    P, i, j = spectrum_matrix(rng, d, 2), rng.integers(d), rng.integers(d)
    s = solver(P, np.zeros(d), np.zeros(d), np.ones(d))
    P[i, j] = bad
    if mirrored:
        P[j, i] = bad
    with pytest.raises(ValueError, match="must be finite"):
        s.update(P, np.zeros(d))


@quick
@given(seed=seeds, d=st.integers(2, 20), decades=st.floats(-7, 0), entries=st.integers(1, 5))
@example(seed=1, d=18, decades=-1.0, entries=1)
def test_an_unsymmetric_P_is_found_wherever_it_differs(seed, d, decades, entries):
    rng = np.random.default_rng(seed)
    P = spectrum_matrix(rng, d, 1)
    s = solver(P, np.zeros(d), np.zeros(d), np.ones(d))
    above = bool(rng.integers(2))  # the same added on both sides would leave P symmetric
    for _ in range(entries):
        i, j = sorted(rng.choice(d, 2, replace=False), reverse=above)
        P[i, j] += 10**decades * rng.uniform(0.5, 1)
    with pytest.raises(ValueError, match="not symmetric"):
        s.update(P, np.zeros(d))


@quick
@given(seed=seeds, d=st.integers(1, 30), decades=st.floats(0, 8))
def test_a_warm_start_from_anywhere_finds_the_cold_answer(seed, d, decades):
    rng = np.random.default_rng(seed)
    P, q, lb, ub = random_program(seed, d, decades)
    s = solver(P, q, lb, ub)
    cold = s.solve().copy()
    warm = s.solve(rng.normal(size=d)).copy()
    assert 0.5 * (warm - cold) @ P @ (warm - cold) <= 1e-13 * np.abs(q) @ np.abs(cold) + 1e-300
    again = s.solve(cold)
    np.testing.assert_allclose(again, cold, rtol=0, atol=10**decades * 1e-13)
    assert s.solution().extras["refinements"] <= 3


@quick
@given(seed=seeds, d=st.integers(1, 30))
def test_the_setting_warm_follows_a_drifting_problem(seed, d):
    rng = np.random.default_rng(seed)
    P, q, lb, ub = random_program(seed, d, 4)
    s = solver(P, q, lb, ub, warm=True)
    for _ in range(5):
        row = rng.normal(size=d)
        P, q = P + 0.1 * np.outer(row, row), q + 0.1 * rng.normal() * row
        s.update(P, q)
        assert residual(P, q, lb, ub, s.solve()) < 1e-13 * d


@quick
@given(seed=seeds, d=st.integers(1, 40))
def test_a_cold_answer_is_the_same_to_the_last_bit_whatever_was_solved_before(seed, d):
    rng = np.random.default_rng(seed)
    P, q, lb, ub = random_program(seed, d, 6)
    s = solver(P, q, lb, ub)
    first = s.solve().copy()
    s.update(spectrum_matrix(rng, d, 2), rng.normal(size=d))
    s.solve(rng.normal(size=d))
    s.update(P, q)
    s.solve(rng.normal(size=d))
    assert (s.solve() == first).all()


@quick
@given(seed=seeds, d=st.integers(1, 30))
@example(seed=29725, d=5)
def test_a_solve_from_any_active_set_reaches_the_optimum(seed, d):
    rng = np.random.default_rng(seed)
    P, q, lb, ub = random_program(seed, d, 4)
    s = solver(P, q, lb, ub, warm=True)
    best = s.solve().copy()
    sides = np.where(lb == ub, 2, np.where(best <= lb, -1, np.where(best >= ub, 1, 0)))
    for i in np.flatnonzero(lb < ub):
        sides[i] = rng.choice([0, *[-1] * bool(lb[i] > -INF), *[1] * bool(ub[i] < INF)])
    s.counts("side")[:d] = np.where(sides == 2, -1, sides)
    # a condition number of 1e4 lets the rounding of either answer move it by 1e4 eps of its size
    np.testing.assert_allclose(s.solve(), best, rtol=0, atol=2e4 * EPS * np.abs(best).max())


@quick
@given(seed=seeds, d=st.integers(2, 30), decades=st.floats(0, 6), cap=st.integers(1, 3))
def test_a_cap_of_exchanges_ends_at_a_feasible_point_from_which_warm_solves_reach_the_optimum(seed, d, decades, cap):
    P, q, lb, ub = random_program(seed, d, decades)
    best, s = solver(P, q, lb, ub).solve(), solver(P, q, lb, ub, warm=True, most_exchanges=cap)
    for _ in range(3 * d):
        x = s.solve()
        assert inside(x, lb, ub)
        extras = s.solution().extras
        if not extras["capped"]:
            break
        assert not s.solution().found
    assert s.solution().found
    assert 0.5 * (x - best) @ P @ (x - best) <= 1e-13 * np.abs(q) @ np.abs(best) + 1e-300
