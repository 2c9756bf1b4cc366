"""The exact cost of an answer above the certified optimum."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from every_active_set import INF, boxes, corner, cost, feasible_stationary_points, fractions, polyhedra
from flint import fmpq
from hypothesis import given, settings
from hypothesis import strategies as st
from qpsolvers import Problem

from solvers.certificate import Infeasible, NotCertified, Unbounded, certify, exact_cost_gap
from solvers.exact import linear_algebra as exact_linear_algebra


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
    assert exact_linear_algebra.nearest_double(-(fmpq(2) ** 1024)) == -INF


def test_a_value_that_is_too_high_is_disproved_by_a_better_point() -> None:
    proof = replace(certify(corner, np.zeros(2)), value="-1/2", value_rounded=-0.5)
    with pytest.raises(NotCertified, match=r"a feasible point costs 0.5 less than the certified optimum"):
        exact_cost_gap(corner, proof, np.array([1.0, 0.0]))
