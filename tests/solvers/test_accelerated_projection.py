"""The accelerated projected gradient method against the exact solver."""

import numpy as np
import pytest
from box_programs import INF, random_program, relative_gap, seeds, set_up
from hypothesis import given, settings
from hypothesis import strategies as st

from solvers import Problem, get


def solved(name, P, q, lb, ub, **settings_):
    s = set_up(name, Problem(P, q, lb=lb, ub=ub), **settings_)
    return s.solve().copy(), s


@settings(max_examples=40, deadline=None)
@given(seed=seeds, d=st.integers(1, 30), decades=st.floats(0, 6))
def test_the_default_reaches_the_optimal_cost_to_1e_12(seed, d, decades):
    P, q, lb, ub = random_program(seed, d, decades)
    x, _ = solved("accelerated_projection", P, q, lb, ub)
    assert relative_gap(P, q, lb, ub, x, least=1.0) < 1e-12


@pytest.mark.parametrize("rung", get("accelerated_projection").ladder(1.0)[:6])
def test_each_rung_meets_its_tolerance_on_the_projected_gradient(rung):
    P, q, lb, ub = random_program(4, 18, 4)
    x, s = solved("accelerated_projection", P, q, lb, ub, diagonal_scaling=False, **rung)
    assert s.solution().found
    eta = 1 / np.linalg.eigvalsh(P)[-1]
    projected = (x - np.clip(x - eta * (P @ x + q), lb, ub)) / eta
    # The test looks at y, the answer is one step on: its own projected gradient is at most as long.
    assert np.linalg.norm(projected) <= 1.001 * rung["tolerance"] * max(
        np.linalg.norm(q), np.linalg.norm(P @ np.clip(np.zeros(18), lb, ub) + q)
    )


def test_it_needs_far_fewer_steps_than_the_plain_recursion():
    P, q, lb, ub = random_program(5, 18, 4)
    plain, _ = solved("projected_difference", P, q, lb, ub, diagonal_scaling=True, steps=2000)
    fast, s = solved("accelerated_projection", P, q, lb, ub, steps=2000)
    assert s.solution().extras["steps"] <= 2000
    assert relative_gap(P, q, lb, ub, fast, 1.0) < 1e-3 * relative_gap(P, q, lb, ub, plain, 1.0)


def test_a_warm_start_at_the_answer_takes_one_step():
    program = random_program(6, 18, 3)
    (best, _), (_, s) = solved("box_active_set", *program), solved("accelerated_projection", *program, tolerance=1e-9)
    np.testing.assert_allclose(s.solve(best), best, atol=1e-8)
    assert s.solution().extras["steps"] == 1


def test_an_answer_at_a_bound_of_the_scaled_variables_is_at_the_bound_and_has_its_multiplier():
    P, q = np.array([[105.0, 59.0], [59.0, 43.0]]), np.array([-656.0, -408.0])
    x, s = solved("accelerated_projection", P, q, np.full(2, -INF), np.array([0.5, 1.1]))
    assert (x.tolist(), s.solution().is_optimal(1e-9)) == ([0.5, 1.1], True)


@pytest.mark.parametrize("size", [-600, -515, 0, 515, 600])
@pytest.mark.parametrize("name", ["accelerated_projection", "projected_difference"])
def test_what_is_found_does_not_depend_on_the_size_of_q(name, size):
    P, q, lb, ub = random_program(3, 6, 2)
    best, _ = solved("box_active_set", P, q, lb, ub)
    x, s = solved(name, P, *(np.ldexp(each, size) for each in (q, lb, ub)), tolerance=1e-10)
    with np.errstate(over="ignore", invalid="ignore"):  # in the cost
        assert s.solution().found
    np.testing.assert_allclose(np.ldexp(x, -size), best, rtol=0, atol=1e-7)


FLAT = (np.diag([1.0, 1e-20]), np.array([1.0, -1.0]), np.array([1.0, 1e18]), np.full(2, INF))
"""A program whose steps are lost in the rounding of its second variable, far from the optimum at 1e20."""


@pytest.mark.parametrize(
    ("name", "program", "settings_", "found"),
    [
        *(("projected_difference", random_program(5, 18, 2), {"steps": k}, k > 1) for k in (0, 1, 15200)),
        ("accelerated_projection", random_program(5, 18, 2), {"steps": 3}, False),
        ("projected_difference", FLAT, {}, False),
        ("projected_difference", FLAT, {"tolerance": 1e-6}, False),
        ("accelerated_projection", FLAT, {"diagonal_scaling": False}, False),
        ("accelerated_projection", FLAT, {}, True),
    ],
)
def test_an_answer_is_found_only_if_its_own_projected_gradient_is_short_however_short_the_last_step_was(
    name, program, settings_, found
):
    assert solved(name, *program, **settings_)[1].solution().found == found


@pytest.mark.parametrize("scale", [1e-100, 1e-12, 1e12, 1e100])
def test_a_variable_without_a_cost_of_its_own_goes_to_its_bound_at_any_scale(scale):
    P, q = np.diag([2.0, 0.0, 1.0]) * scale, np.array([1.0, -1.0, 3.0]) * scale
    x, s = solved("accelerated_projection", P, q, -np.ones(3), np.full(3, 2.0))
    assert s.solution().found
    np.testing.assert_allclose(x, [-0.5, 2.0, -1.0], rtol=1e-9)
