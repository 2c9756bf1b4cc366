"""The exact box solver against rational arithmetic, and its documented rules for hard problems."""

import numpy as np
import pytest
from box_programs import INF, gap, inside, random_program, seeds, spectrum_matrix
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


@quick
@given(seed=seeds, d=st.integers(1, 9))
def test_badly_scaled_variables_do_not_change_the_exactness(seed, d):
    P, q, lb, ub = random_program(seed, d, 3)
    scale = 10 ** np.random.default_rng(seed).uniform(-6, 6, d)
    P, q, lb, ub = P * np.outer(scale, scale), q * scale, lb / scale, ub / scale
    assert relative_gap(P, q, lb, ub, solver(P, q, lb, ub).solve()) < 1e-18


@pytest.mark.parametrize("seed", range(10))
def test_sixty_variables_at_a_condition_number_of_1e11_end_without_cycling(seed):
    rng = np.random.default_rng(seed)
    P, d = spectrum_matrix(rng, 60, 11), 60
    q, lb = -P @ rng.normal(size=d) + 10 ** rng.uniform(-8, 0) * rng.normal(size=d), np.full(d, -0.1)
    s = solver(P, q, lb, None)
    x, extras = s.solve(), s.solution().extras
    assert extras["exchanges"] + extras["refinements"] < 5 * d
    assert residual(P, q, lb, np.full(d, INF), x) < 100 * d * EPS


def test_a_linear_program_in_a_far_box_ends_at_its_corner():
    s = solver(np.zeros((3, 3)), np.array([-1.0, 2.0, 1e-3]), np.full(3, -1e6), np.full(3, 1e6))
    assert s.solve().tolist() == [1e6, -1e6, -1e6]


def test_directions_in_the_null_space_of_P_stay_at_the_warm_start_or_go_to_zero():
    P = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    s = solver(P, np.array([-2.0, -2.0, 0.0]), np.full(3, -INF), np.full(3, INF))
    np.testing.assert_allclose(s.solve(), [1.0, 1.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(s.solve(np.array([3.0, 0.0, 7.0])), [2.5, -0.5, 7.0], atol=1e-4)
    assert s.solution().extras["regularised"]


@quick
@given(seed=seeds, d=st.integers(2, 20), change=st.sampled_from([np.nan, INF, -INF, 1e-7, 1e-3, 1.0]))
@example(seed=1, d=18, change=0.1)
def test_one_entry_of_P_that_is_not_finite_or_not_symmetric_is_found_wherever_it_stands(seed, d, change):
    rng = np.random.default_rng(seed)
    P, (i, j) = spectrum_matrix(rng, d, 1), rng.choice(d, 2, replace=False)
    s = solver(P, np.zeros(d), np.zeros(d), np.ones(d))
    P[i, j] += change
    if not np.isfinite(change) and rng.integers(2):
        P[j, i] = P[i, j]
    with pytest.raises(ValueError, match="not symmetric" if np.isfinite(change) else "must be finite"):
        s.update(P, np.zeros(d))


@quick
@given(seed=seeds, d=st.integers(1, 30), decades=st.floats(0, 8))
def test_a_warm_start_from_anywhere_at_any_bounds_finds_the_cold_answer(seed, d, decades):
    rng = np.random.default_rng(seed)
    P, q, lb, ub = random_program(seed, d, decades)
    s = solver(P, q, lb, ub)
    cold, start = s.solve().copy(), rng.normal(size=d)
    for bound in (lb, ub):
        start = np.where(np.isfinite(bound) & (rng.random(d) < 0.4), bound, start)
    warm = s.solve(start).copy()
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
