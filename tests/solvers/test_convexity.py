"""Convexity of the data: exact, and where rounding has spoilt it restored by the smallest shift that does so."""

import math
from dataclasses import replace
from fractions import Fraction
from itertools import chain, combinations

import numpy as np
import pytest
from every_active_set import corner, fractions
from hypothesis import given, settings
from hypothesis import strategies as st
from qpsolvers import Problem

from solvers.certificate import NotCertified, RoundingDecides, certify, verify
from solvers.exact import linear_algebra as exact_linear_algebra
from solvers.exact.problem import DoubleProblem


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
    data = DoubleProblem.of(Problem(P, np.zeros(d)))
    if data._is_plainly_definite():
        assert exact_linear_algebra.semidefinite_rank(data._symmetric[0]) == d
    elif decades < 8.0:  # it recognises matrices that are not nearly singular
        raise AssertionError(f"condition 1e{decades:.1f} is not recognised")


def is_semidefinite(P: np.ndarray, shift: Fraction) -> bool:
    """All principal minors are nonnegative, in fractions."""
    M = [[v + (shift if i == j else 0) for j, v in enumerate(row)] for i, row in enumerate(fractions(P))]
    subsets = chain.from_iterable(combinations(range(len(M)), k) for k in range(1, len(M) + 1))
    return all(determinant([[M[i][j] for j in rows] for i in rows]) >= 0 for rows in subsets)


def determinant(M: list[list[Fraction]]) -> Fraction:
    if not M:
        return Fraction(1)
    return sum(
        ((-1) ** j * v * determinant([row[:j] + row[j + 1 :] for row in M[1:]]) for j, v in enumerate(M[0]) if v),
        Fraction(0),
    )


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
    "P",
    [np.diag([1.0, -1e-9]), np.array([[0.0, 1.0], [1.0, 0.0]]), np.diag([-1.0, -1.0])],
    ids=["slightly", "saddle", "concave"],
)
def test_a_problem_that_is_not_convex_is_refused(P: np.ndarray) -> None:
    with pytest.raises(NotCertified, match="P is not convex"):
        certify(Problem(P, np.zeros(2), lb=-np.ones(2), ub=np.ones(2)), np.zeros(2))


def test_an_unsymmetric_P_means_its_symmetric_part() -> None:
    skewed = Problem(np.array([[2.0, 1.0], [-1.0, 4.0]]), corner.q, lb=corner.lb, ub=corner.ub)
    assert certify(skewed, np.zeros(2)).value == certify(corner, np.zeros(2)).value
