"""The exact box solver against rational arithmetic, and its documented rules for hard problems.

What "found" promises is judged by a relative cost gap of at most 1e-9, whatever the scale of P and q, with zero and
equal rows, curvatures down to rounding, and every kind of bound; refused programs have no optimum."""

from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from box_programs import INF, inside, random_program, relative_gap, seeds, set_up, spectrum_matrix
from hypothesis import example, given, settings
from hypothesis import strategies as st
from programs import ALL
from qpsolvers import Problem

from solvers import get
from solvers.certificate import NotCertified, certify


def hard_program(seed):
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


def outcome(call):
    """The answer, or the sentence of the refusal."""
    try:
        return call().copy()
    except ValueError as refusal:
        return str(refusal)


quick = settings(max_examples=60, deadline=None)


def solver(P, q, lb, ub, **settings_):
    return set_up("box_active_set", Problem(P, q, lb=lb, ub=ub), **settings_)


@settings(max_examples=120, deadline=None)
@given(seed=seeds, d=st.integers(1, 20), decades=st.floats(0, 12), spread=st.sampled_from([0, 6]))
def test_it_ends_at_the_exact_optimum_and_at_condition_numbers_up_to_1e12_within_1e_12_of_its_cost_at_any_scales(
    seed, d, decades, spread
):
    P, q, lb, ub = random_program(seed, d, decades)
    scale = 10 ** np.random.default_rng(seed).uniform(-spread, spread, d)
    P, q, lb, ub = P * np.outer(scale, scale), q * scale, lb / scale, ub / scale
    assert relative_gap(P, q, lb, ub, solver(P, q, lb, ub).solve()) < (1e-18 if decades <= 7 else 1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_sixty_variables_at_a_condition_number_of_1e11_end_without_cycling(seed):
    rng = np.random.default_rng(seed)
    P, d = spectrum_matrix(rng, 60, 11), 60
    q, lb = -P @ rng.normal(size=d) + 10 ** rng.uniform(-8, 0) * rng.normal(size=d), np.full(d, -0.1)
    s = solver(P, q, lb, None)
    x, extras = s.solve(), s.solution().extras
    assert extras["exchanges"] + extras["refinements"] < 5 * d
    assert violation(P, q, lb, np.full(d, INF), x) < 100 * d * np.finfo(float).eps


ONE_ROW = np.diag([0.0, 1e-15]), [2.0, 0.0], [4.0, 1.0]
FLAT = {
    "a linear program in a far box": (np.zeros((3, 3)), [-1e6] * 3, [1e6] * 3, [-1.0, 2.0, 1e-3], [1e6, -1e6, -1e6]),
    "down in the variable without curvature": (*ONE_ROW, [-7e-15, 7e-15], [4.0, 0.0]),
    "up in it": (*ONE_ROW, [7.0, -7.0], [2.0, 1.0]),
    "level, and it stays at the start": (*ONE_ROW, [0.0, 0.0], [3.0, 0.0]),
    "down without a bound": (*ONE_ROW[:2], [INF, INF], [-7.0, 7.0], "unbounded"),
}


@pytest.mark.parametrize("what", FLAT)
def test_a_variable_whose_row_of_P_is_zero_goes_to_the_bound_that_q_points_to(what):
    P, lb, ub, q, expected = FLAT[what]
    s = solver(P, np.zeros(len(lb)), np.array(lb), np.array(ub))
    s.update(q=np.array(q))
    found = outcome(s.solve if any(q) else partial(s.solve, np.array([3.0, 1.0])))
    assert str(expected) in found if isinstance(found, str) else found.tolist() == expected


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


def test_entries_of_P_that_differ_from_their_mirrors_are_found_one_by_one_and_what_rounding_makes_of_them_is_taken():
    """Differences that cancel in one projection v'Pw - w'Pv, w = v^2."""
    v = np.modf(0.618033988749895 * np.arange(1, 4))[0]
    apart = np.array([v[i] * v[j] * (v[j] - v[i]) for i, j in ((0, 1), (0, 2))])
    P, s = np.eye(3), get("box_active_set")
    P[0, 1], P[0, 2] = 0.1 / apart[0], -0.1 / apart[1]
    P *= 0.05
    np.fill_diagonal(P, 1)
    with pytest.raises(ValueError, match="not symmetric"):
        s.setup(Problem(P, -np.ones(3), lb=np.zeros(3), ub=np.ones(3)))
    A = np.random.default_rng(0).normal(size=(60, 18))
    rounded, q = A.T @ A + 1e-13 * np.triu(np.ones((18, 18)), 1), -A.T @ A @ np.ones(18)
    s.setup(Problem(rounded, q))
    x = s.solve().copy()
    s.setup(Problem((rounded + rounded.T) / 2, q))
    np.testing.assert_array_equal(x, s.solve())


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
    np.testing.assert_allclose(s.solve(cold), cold, rtol=0, atol=10**decades * 1e-13)
    assert s.solution().extras["refinements"] <= 3


def test_a_warm_start_at_bounds_of_a_nearly_singular_program_keeps_no_bound_that_costs_more():
    """Rounding changes the sign of pivots here."""
    for seed in range(1000 if ALL else 200):
        rng = np.random.default_rng(seed)
        d = int(rng.integers(2, 5))
        P = np.eye(d)
        P[0, 1] = P[1, 0] = 1 - 10 ** rng.uniform(-15.5, -9)
        lb = np.round(rng.normal(size=d), 1)
        ub, q = lb + np.round(np.abs(rng.normal(size=d)), 1), -P @ rng.normal(size=d)
        s = solver(P, q, lb, ub)
        for start in (lb, ub, np.where(rng.random(d) < 0.5, lb, ub)):
            x = outcome(partial(s.solve, start))
            assert isinstance(x, str) or violation(P, q, lb, ub, x) <= 1e-12, seed


@pytest.mark.parametrize("seed", range(25))
@pytest.mark.parametrize("decades", [0.9, 4, 8, 12])
def test_a_program_at_rest_whose_optimum_is_zero_has_exactly_that_answer(decades, seed):
    d, rng = 18, np.random.default_rng(seed)
    P, q = spectrum_matrix(rng, d, decades), np.maximum(rng.normal(size=d), 0)
    s = solver(P, q, np.where(q > 0, 0, -INF), np.full(d, INF))
    assert not s.solve().any()
    assert not s.solve(rng.normal(size=d)).any()
    s = solver(P, np.zeros(d), np.full(d, -0.5), np.ones(d))
    assert not s.solve(np.where(rng.random(d) < 0.5, -0.5, rng.normal(size=d))).any()


@pytest.mark.parametrize("seed", range(25))
@pytest.mark.parametrize("bound", [0.0, -10.0, -INF])
def test_a_warm_start_is_no_reason_to_refuse_a_program_that_is_solved_cold(bound, seed):
    rng = np.random.default_rng(seed)
    d = int(rng.integers(2, 19))
    A = rng.normal(size=(d, d - 1))
    s = solver(A @ A.T, np.zeros(d), np.full(d, bound), np.full(d, INF))
    x = s.solve(rng.normal(size=d))
    assert s.solution().found
    assert x @ A @ A.T @ x <= 1e-20


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
        assert violation(P, q, lb, ub, s.solve()) < 1e-13 * d


@quick
@given(seed=seeds, d=st.integers(1, 40), hard=st.booleans())
def test_a_cold_answer_is_the_same_to_the_last_bit_whatever_was_solved_or_refused_before(seed, d, hard):
    rng = np.random.default_rng(seed)
    P, q, lb, ub = hard_program(seed) if hard else random_program(seed, d, 6)
    s = solver(P, q, lb, ub)
    first = outcome(s.solve)
    s.update(spectrum_matrix(rng, q.size, 2), 1e6 * rng.normal(size=q.size))
    outcome(lambda: s.solve(rng.normal(size=q.size)))
    with pytest.raises(ValueError, match="finite"):
        s.update(q=np.full(q.size, np.nan))
    with pytest.raises(ValueError, match="not ready"):
        s.solve()
    s.update(P, q)
    outcome(lambda: s.solve(rng.normal(size=q.size)))
    np.testing.assert_equal(outcome(s.solve), first)


@settings(max_examples=120, deadline=None)
@given(seed=seeds, d=st.integers(2, 30), decades=st.floats(0, 6), cap=st.integers(1, 3), hard=st.booleans())
def test_a_cap_of_exchanges_ends_at_a_feasible_point_from_which_warm_solves_reach_the_optimum(
    seed, d, decades, cap, hard
):
    P, q, lb, ub = hard_program(seed) if hard else random_program(seed, d, decades)
    s = solver(P, q, lb, ub, warm=True, most_exchanges=cap)
    for _ in range(3 * d):
        x = outcome(s.solve)
        if hard and isinstance(x, str):
            return
        assert inside(x, lb, ub)
        extras = s.solution().extras
        assert extras["exchanges"] <= cap
        if not extras["capped"]:
            break
        assert not s.solution().found
    if not hard:
        best = solver(P, q, lb, ub).solve()
        assert s.solution().found
        assert 0.5 * (x - best) @ P @ (x - best) <= 1e-13 * np.abs(q) @ np.abs(best) + 1e-300


CONTRADICTED = {
    "any_program": {2812, 3241, 4954, 5741, 8317, 8380, 13_938},
    "hard_program": {1006, 1043, 6910, 8921, 11_050, 11_913, 13_136, 14_935, 15_749},
}
"""Programs that are refused though their optimum is certified, a miss: 5741 is a Hilbert matrix of 20, four eigenvalues
negative by rounding."""


def any_program(seed):
    """P, q, lb, ub of 1 to 200 variables, mostly few: spectra down to 1e-14, ties, integers, Hilbert matrices, singular
    P."""
    rng = np.random.default_rng(seed)
    d = int(rng.integers(1, 201)) if rng.random() < 0.15 else int(rng.integers(1, 25))
    kind = rng.choice(["spectrum", "integers", "hilbert", "singular", "ties"])
    if kind == "spectrum":
        U = np.linalg.qr(rng.normal(size=(d, d)))[0]
        P = U * 10 ** -(rng.uniform(0, 14) * np.linspace(0, 1, d)) @ U.T
    elif kind == "integers":
        A = rng.integers(-2, 3, (d, d))
        P = (A @ A.T + rng.integers(0, 2) * np.eye(d)).astype(float)
    elif kind == "hilbert":
        P = 1.0 / (np.arange(d)[:, None] + np.arange(d) + 1.0)
        P = np.round(P, int(rng.integers(6, 16))) if rng.random() < 0.5 else P
    elif kind == "singular":
        A = rng.normal(size=(d, int(rng.integers(0, d + 1))))
        P = A @ A.T
    else:
        k = max(1, d // 3)
        B = rng.normal(size=(k, k))
        P = np.kron(np.eye(-(-d // k)), B @ B.T + 0.1 * np.eye(k))[:d, :d]
    P = (P + P.T) / 2
    lb = np.where(rng.random(d) < 0.7, np.round(rng.normal(size=d), 1), -INF)
    ub = np.where(rng.random(d) < 0.4, np.where(lb > -INF, lb, 0) + np.round(np.abs(rng.normal(size=d)), 1), INF)
    if rng.random() < 0.3:
        lb, ub = np.full(d, -1.0), np.full(d, 1.0)
    q = -P @ rng.normal(size=d) if rng.random() < 0.7 else rng.normal(size=d)
    return P, np.round(q) if kind in ("integers", "ties") else q, lb, ub


def violation(P, q, lb, ub, x):
    """The largest violation of the optimality conditions in extended precision, relative to the largest terms of a
    gradient."""
    g = P.astype(np.longdouble) @ x + q
    wrong = np.where(lb == ub, 0, np.where(x <= lb, np.minimum(g, 0), np.where(x >= ub, np.maximum(g, 0), g)))
    size = np.abs(P) @ np.abs(x) + np.abs(q)
    return float(np.abs(wrong).max(initial=0) / max(size.max(initial=0), 1e-300))


def is_refuted(P, q, lb, ub, sentence):
    """Whether the certificate contradicts a refusal: an optimum is proved, and the curvature of P towards it is above
    rounding."""
    try:
        proof = certify(Problem(P, q, lb=lb, ub=ub), np.clip(np.zeros(q.size), lb, ub))
    except NotCertified:
        return False
    x = [Fraction(entry) for entry in proof.x]
    curvature = sum(x[i] * x[j] * Fraction(P[i, j]) for i in range(q.size) for j in range(q.size)) / (
        sum(v * v for v in x) or 1
    )
    return "indefinite" in sentence or curvature > Fraction(q.size * np.finfo(float).eps * P.diagonal().max())


def costs_more(P, q, lb, ub, x):
    """Whether an answer has a certified cost gap of over 1e-9."""
    try:
        return relative_gap(P, q, lb, ub, x, least=0.0) > 1e-9
    except NotCertified:
        return False


def sweep(draw, seeds):
    """The number of programs with an answer, and the programs that contradict one of the two statements."""
    found, wrong = 0, []
    for seed in seeds:
        P, q, lb, ub = draw(seed)
        try:
            s = solver(P, q, lb, ub)
            x = s.solve().copy()
        except ValueError as refusal:
            if q.size <= 24 and is_refuted(P, q, lb, ub, str(refusal)):
                wrong.append(seed)
            continue
        good = violation(P, q, lb, ub, x) <= 1e-12 and (q.size > 9 or not costs_more(P, q, lb, ub, x))
        found += s.solution().found
        if not inside(x, lb, ub) or (s.solution().found and not good):
            wrong.append(seed)
    return found, wrong


@pytest.mark.parametrize("draw", [any_program, hard_program])
@pytest.mark.parametrize(
    ("seeds", "least"),
    [
        (range(100), 85),
        pytest.param(range(100, 400), 255, marks=pytest.mark.slow),
        pytest.param(range(400, 16_000), 13_500, marks=pytest.mark.nightly),
    ],
)
def test_found_answers_are_optimal_and_refused_programs_have_no_optimum(draw, seeds, least):
    found, wrong = sweep(draw, seeds)
    assert set(wrong) <= CONTRADICTED[draw.__name__]
    assert found > least


@pytest.mark.parametrize("curvature", [1e-3, 1e-9, 5e-12, 1e-12, 3e-13, 1e-14, 1.6e-15])
def test_a_curvature_far_below_one_does_not_spoil_the_cost(curvature):
    P = np.array([[1.0, 1.0 - curvature], [1.0 - curvature, 1.0]])
    program = (P, np.array([1.0, -1.0]), np.full(2, -INF), np.full(2, INF))
    s = solver(*program)
    assert relative_gap(*program, s.solve(), least=0.0) <= 1e-18
    assert s.solution().found


@settings(max_examples=200, deadline=None)
@given(seed=seeds, of_P=st.integers(-400, 400), of_x=st.integers(-400, 400), hard=st.booleans())
@example(seed=0, of_P=1, of_x=0, hard=False)
@example(seed=0, of_P=0, of_x=512, hard=False)
@example(seed=0, of_P=0, of_x=-531, hard=False)
def test_powers_of_two_times_the_data_change_no_bit_of_the_answer(seed, of_P, of_x, hard):
    P, q, lb, ub = hard_program(seed) if hard else random_program(seed, 6, 4)
    x = outcome(solver(P, q, lb, ub).solve)
    scaled = (np.ldexp(P, of_P), np.ldexp(q, of_P + of_x), np.ldexp(lb, of_x), np.ldexp(ub, of_x))
    np.testing.assert_equal(outcome(solver(*scaled).solve), x if isinstance(x, str) else np.ldexp(x, of_x))
