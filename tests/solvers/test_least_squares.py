"""Least squares with bounds against the exact optimum of the same doubles, and against SciPy's BVLS."""

import copy
import pickle
import re
from fractions import Fraction

import numpy as np
import pytest
from box_programs import INF, random_bounds, seeds
from hypothesis import example, given, settings
from hypothesis import strategies as st
from qpsolvers import Problem
from scipy.optimize import lsq_linear

from solvers import BoxLeastSquares, get
from solvers.certificate import certify

EPS = np.finfo(float).eps


def data(seed, m, d, decades, noise):
    """A of condition 10^decades, b within its range but for the noise, and bounds of every kind."""
    rng = np.random.default_rng(seed)
    r = min(m, d)
    U, V = (np.linalg.qr(rng.normal(size=(n, n)))[0] for n in (m, d))
    A = (U[:, :r] * 10 ** -(decades * np.linspace(0, 1, r))) @ V[:r]
    return A, A @ rng.normal(size=d) + noise * rng.normal(size=m), *random_bounds(rng, d)


def cost(A, b, x):
    """½ ‖A x − b‖² in rationals."""
    residuals = (
        sum(Fraction(float(a)) * Fraction(float(v)) for a, v in zip(row, x, strict=True)) - Fraction(float(right))
        for row, right in zip(A, b, strict=True)
    )
    return sum(r * r for r in residuals) / 2


def least_cost(A, b, lb, ub, x):
    """The certified least cost, of ½ ‖r‖² subject to A x − r = b in variables x and r."""
    (m, d), free = A.shape, np.full(len(A), INF)
    P = np.diag(np.repeat([0.0, 1.0], [d, m]))
    lower, upper = np.concatenate([lb, -free]), np.concatenate([ub, free])
    program = Problem(P, np.zeros(d + m), A=np.hstack([A, -np.eye(m)]), b=b, lb=lower, ub=upper)
    return Fraction(certify(program, np.concatenate([x, A @ x - b])).value)


@settings(max_examples=60, deadline=None)
@given(
    seed=seeds,
    m=st.integers(1, 12),
    d=st.integers(1, 8),
    decades=st.floats(0, 12),
    noise=st.sampled_from([0.0, 1e-8, 1e-3, 1.0]),
)
@example(seed=0, m=12, d=8, decades=12.0, noise=1.0)
@example(seed=1, m=3, d=8, decades=6.0, noise=0.0)
def test_a_found_answer_has_the_exact_least_cost_and_each_is_found_at_condition_numbers_up_to_1e12(
    seed, m, d, decades, noise
):
    A, b, lb, ub = data(seed, m, d, decades, noise)
    fit = BoxLeastSquares(A, b, lb, ub)
    x = fit.solve()
    assert ((lb <= x) & (x <= ub)).all()
    assert fit.found
    least = least_cost(A, b, lb, ub, x)
    rounding = 8 * EPS * (np.linalg.norm(b) + np.linalg.norm(A, axis=0) @ np.abs(x))
    assert cost(A, b, x) - least <= max(Fraction(1.01e-9) * least, Fraction(1.01 * rounding**2))


@settings(max_examples=60, deadline=None)
@given(seed=seeds, m=st.integers(1, 60), d=st.integers(1, 25), decades=st.floats(0, 6))
def test_scipys_bvls_has_no_smaller_cost(seed, m, d, decades):
    A, b, lb, ub = data(seed, m, d, decades, 0.1)
    width = ub - lb
    lb, ub = np.where(width == 0, lb - 0.5, lb), ub  # which it does not take
    other = np.clip(lsq_linear(A, b, (lb, ub), method="bvls", tol=1e-15, max_iter=1000).x, lb, ub)
    fit = BoxLeastSquares(A, b, lb, ub)
    ours, theirs = (np.linalg.norm(A @ x - b) for x in (fit.solve(), other))
    assert fit.found
    assert ours <= theirs * (1 + 1e-9) + 1e-13 * np.linalg.norm(b)


@pytest.mark.parametrize("seed", range(5))
def test_where_the_normal_equations_lose_their_digits_it_does_not(seed):
    A, b, *_ = data(seed, 12, 8, 10.0, 1e-6)
    lb, ub = np.full(8, -2.0), np.full(8, INF)
    normal = get("box_active_set")
    normal.setup(Problem(A.T @ A, -A.T @ b, lb=lb, ub=ub))
    fit = BoxLeastSquares(A, b, lb, ub)
    least = least_cost(A, b, lb, ub, fit.solve())
    assert cost(A, b, normal.solve()) > Fraction(1 + 1e-6) * least
    assert cost(A, b, fit.solve()) < Fraction(1 + 1e-9) * least


@pytest.mark.parametrize("scale", [1e-250, 1e-6, 1e6, 1e250])
def test_powers_of_two_in_the_columns_or_in_all_rows_change_nothing_else(scale):
    A, b, lb, ub = data(5, 20, 7, 4.0, 0.1)
    power = np.exp2(np.round(np.log2(scale)))
    whole = BoxLeastSquares(A * power, b * power, lb, ub)
    long = BoxLeastSquares(A, b * power, lb * power, ub * power)
    factor = np.exp2(np.round(np.log2(scale) * np.linspace(0, 1, 7)))
    plain, scaled = BoxLeastSquares(A, b, lb, ub), BoxLeastSquares(A * factor, b, lb / factor, ub / factor)
    for answer in (scaled.solve() * factor, whole.solve(), long.solve() / power):
        np.testing.assert_array_equal(answer, plain.solve())
    assert scaled.found
    assert whole.found
    assert long.found


def test_dependent_and_zero_columns_and_an_empty_matrix_of_free_variables_are_solved():
    A, b, *_ = data(6, 20, 4, 1.0, 0.1)
    A = np.column_stack([A, A[:, 0] + A[:, 1], np.zeros(20)])
    fit = BoxLeastSquares(A, b)
    x = fit.solve()
    assert fit.found
    assert np.linalg.norm(A @ x - b) == pytest.approx(np.linalg.norm(A @ np.linalg.lstsq(A, b)[0] - b), rel=1e-12)
    held = BoxLeastSquares(np.eye(2), [5.0, -5.0], lb=[0.0, 0.0], ub=[1.0, 0.0])
    assert (held.solve().tolist(), held.found) == ([1.0, 0.0], True)


def test_a_new_right_hand_side_is_solved_as_by_a_new_object_and_a_refused_one_changes_nothing():
    A, b, lb, ub = data(7, 15, 6, 3.0, 0.1)
    fit, other = BoxLeastSquares(A, b, lb, ub), np.ones(15)
    assert not fit.found
    first = fit.solve()
    np.testing.assert_array_equal(fit.solve(other), BoxLeastSquares(A, other, lb, ub).solve())
    np.testing.assert_array_equal(fit.solve(b), first)
    for bad in (np.ones(14), np.full(15, np.nan), np.ones(15) * 1j):
        with pytest.raises(ValueError, match=r"b must be"):
            fit.solve(bad)
        assert fit.found
    np.testing.assert_array_equal(fit.solve(), first)
    for twin in (copy.deepcopy(fit), pickle.loads(pickle.dumps(fit))):
        np.testing.assert_array_equal(twin.solve(), first)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((np.ones(3), np.ones(3)), "A must be a matrix of finite numbers, and its shape is (3,)"),
        ((np.full((2, 2), np.inf), np.ones(2)), "A must be a matrix of finite numbers, and its shape is (2, 2)"),
        ((np.zeros((2, 0)), np.ones(2)), "A must be a matrix of finite numbers, and its shape is (2, 0)"),
        ((np.eye(2) * 1j, np.ones(2)), "A must be made of real numbers, and not of complex128"),
        ((np.eye(2), np.ones(3)), "b must be of shape (2,), and not (3,)"),
        ((np.eye(2), [1.0, np.nan]), "b must be finite"),
        ((np.eye(2), np.ones(2), np.zeros(3)), "lb must be of shape (2,), and not (3,)"),
        ((np.eye(2), np.ones(2), [0.0, np.nan]), "a bound is NaN, a lower"),
        ((np.eye(2), np.ones(2), np.ones(2), np.zeros(2)), "a bound is NaN, a lower one above its upper one"),
    ],
)
def test_what_cannot_be_solved_is_refused_in_a_sentence(arguments, sentence):
    with pytest.raises(ValueError, match=f"^{re.escape(sentence)}"):
        BoxLeastSquares(*arguments)
