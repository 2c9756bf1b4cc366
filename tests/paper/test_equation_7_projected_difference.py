"""(7) as a difference equation, w ← Proj_K(w − η (P w + q)): its stability limit, its path and its two coordinates."""

from functools import partial
from itertools import pairwise

import numpy as np
from box_programs import INF, optimum, seeds, set_up, spectrum_matrix
from hypothesis import given, settings
from hypothesis import strategies as st

from solvers import Problem

quick = settings(max_examples=40, deadline=None)


solver = partial(set_up, "projected_difference")


def trajectory(problem, start, ratio, counts):
    """The iterates after each number of steps; the step is ``ratio`` times the stability limit 2/λ_max(P), below which
    the recursion converges for every q and every convex set."""
    return [
        solver(problem, steps=count, step_ratio=ratio, allow_divergence=True).solve(start).copy() for count in counts
    ]


def bounded(rng, d, decades, size=1.0):
    """A program of d variables, some without bounds."""
    lb, ub = np.where(rng.random(d) < 0.6, -rng.random(d), -INF), np.where(rng.random(d) < 0.6, rng.random(d), INF)
    return Problem(size * spectrum_matrix(rng, d, decades), size * rng.normal(size=d), lb=lb, ub=ub)


@quick
@given(
    seed=seeds, d=st.integers(1, 20), ratio=st.floats(0.05, 1.5), decades=st.floats(0, 12), size=st.floats(-200, 200)
)
def test_the_compiled_steps_are_the_equation_at_any_condition_and_size(seed, d, ratio, decades, size):
    rng = np.random.default_rng(seed)
    problem, w = bounded(rng, d, decades, 10**size), rng.normal(size=d)
    one = solver(problem, steps=1, step_ratio=ratio, allow_divergence=True)
    one.solve()
    eta, path = one.solution().extras["eta"], trajectory(problem, w, ratio, range(6))
    assert 0.999 - 1e-13 <= eta * np.linalg.eigvalsh(problem.P)[-1] / (2.0 * ratio) <= 1.0 + 1e-13
    np.testing.assert_array_equal(path[0], np.clip(w, problem.lb, problem.ub))
    for at, then in pairwise(path):
        expected = np.clip(at - eta * (problem.P @ at + problem.q), problem.lb, problem.ub)
        np.testing.assert_allclose(then, expected, rtol=0, atol=1e-13)


@quick
@given(seed=seeds, d=st.integers(1, 20), ratio=st.floats(0.1, 0.98))
def test_below_the_limit_the_distance_to_the_optimum_never_grows_and_goes_to_zero(seed, d, ratio):
    rng = np.random.default_rng(seed)
    problem = bounded(rng, d, 1.0)
    best = optimum(problem)
    path = trajectory(problem, rng.normal(size=d), ratio, (0, 1, 10, 100, 15200))
    distance = np.linalg.norm(np.subtract(path, best), axis=1)
    assert (np.diff(distance) <= 1e-12 * (1 + distance[:-1])).all()
    assert distance[-1] <= 1e-10 * (1 + np.linalg.norm(best))


@quick
@given(seed=seeds, d=st.integers(1, 20), ratio=st.floats(1.02, 3.0))
def test_above_the_limit_a_free_problem_diverges(seed, d, ratio):
    rng = np.random.default_rng(seed)
    P, q = spectrum_matrix(rng, d, 2.0), rng.normal(size=d)
    best = -np.linalg.solve(P, q)
    begin, end = trajectory(Problem(P, q), best + 1e-3 * np.linalg.eigh(P)[1][:, -1], ratio, (0, 100))
    assert np.linalg.norm(end - best) > 10 * np.linalg.norm(begin - best)


def test_a_step_beyond_the_limit_that_is_allowed_diverges_and_is_not_called_found():
    s = solver(Problem(np.eye(2), np.ones(2)), step_ratio=2.0, allow_divergence=True)
    with np.errstate(all="ignore"):
        assert np.abs(s.solve()).max() > 1e6 or not np.isfinite(s.solve()).all()
        assert not s.solution().found


def test_the_start_is_the_projection_of_the_warm_start_or_of_zero():
    s = solver(Problem(np.eye(2), np.zeros(2), lb=np.array([1.0, -1.0])), steps=0)
    assert s.solve().tolist() == [1.0, 0.0]
    assert s.solve(np.array([-5.0, 5.0])).tolist() == [1.0, 5.0]


def test_a_tolerance_stops_early_and_is_off_by_default():
    rng = np.random.default_rng(2)
    problem = Problem(spectrum_matrix(rng, 18, 2.0), rng.normal(size=18), lb=np.zeros(18))
    default, early = solver(problem), solver(problem, tolerance=1e-6)
    _, w = default.solve(), early.solve()
    assert early.solution().extras["steps"] < default.solution().extras["steps"] == 15200
    eta = early.solution().extras["eta"]
    moved = np.linalg.norm(np.maximum(w - eta * (problem.P @ w + problem.q), 0) - w) / eta
    assert moved <= 1e-6 * np.linalg.norm(problem.q)


@quick
@given(seed=seeds, d=st.integers(1, 12))
def test_diagonal_scaling_changes_the_path_and_not_the_answer(seed, d):
    rng = np.random.default_rng(seed)
    scale = 10 ** rng.uniform(-2, 2, d)
    P, q = spectrum_matrix(rng, d, 1.0) * np.outer(scale, scale), rng.normal(size=d) * scale
    problem = Problem(P, q, lb=-rng.random(d) / scale)
    w = solver(problem, diagonal_scaling=True).solve()
    np.testing.assert_allclose(w * scale, optimum(problem) * scale, rtol=0, atol=1e-9)
    assert (w >= problem.lb).all()
