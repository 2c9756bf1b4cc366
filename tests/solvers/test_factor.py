"""The factor of the free variables alone (solvers/core/factor.h): its solutions, what it leaves alone, and when a pivot
is not safe."""

import numpy as np
import pytest
from box_programs import Array, seeds, spectrum_matrix
from hypothesis import given, settings
from hypothesis import strategies as st

from solvers.core import bindings, block, padded

quick = settings(max_examples=60, deadline=None)


def solve(P: Array, right: Array, free: Array, least: float = 0.0) -> tuple[bool, Array]:
    """Whether every pivot is more than that share of the diagonal, and x, NaN where nothing was written."""
    d = right.size
    rows, x = np.full((d, padded(d + 1)), np.nan), np.full(d, np.nan)
    rows[:, :d], rows[:, d] = np.triu(P) + np.tril(np.full((d, d), np.nan), -1), right
    return bool(bindings.factor_solve(block(bindings.factor_bytes(d)), free.astype(float), rows, least, x)), x


@quick
@given(seed=seeds, d=st.integers(1, 40), decades=st.floats(0, 6))
def test_what_is_free_solves_its_system_and_what_is_not_is_left_alone(seed: int, d: int, decades: float) -> None:
    rng = np.random.default_rng(seed)
    P, right, free = spectrum_matrix(rng, d, decades), rng.normal(size=d), rng.random(d) < rng.random()
    safe, x = solve(P, right, free)
    assert safe
    assert np.isnan(x[~free]).all()
    F = np.flatnonzero(free)
    size = np.abs(P[np.ix_(F, F)]) @ np.abs(x[F]) + np.abs(right[F])
    assert (np.abs(P[np.ix_(F, F)] @ x[F] - right[F]) <= 4 * d * np.finfo(float).eps * size.max(initial=0)).all()


@quick
@given(seed=seeds, d=st.integers(2, 40))
def test_what_is_left_out_has_no_part_in_the_solution_whatever_it_is(seed: int, d: int) -> None:
    rng = np.random.default_rng(seed)
    P, right, free = spectrum_matrix(rng, d, 3), rng.normal(size=d), rng.random(d) < 0.5
    expected = solve(P, right, free)[1]
    P[~free], P[:, ~free], right[~free] = np.nan, np.nan, np.nan
    np.testing.assert_array_equal(solve(P, right, free)[1], expected)


@pytest.mark.parametrize("d", [2, 8, 9, 18])
def test_a_pivot_is_safe_only_above_its_share_of_the_diagonal(d: int) -> None:
    everything, right = np.ones(d, dtype=bool), np.ones(d)
    P = np.eye(d)
    P[0, -1] = P[-1, 0] = np.sqrt(1 - 1e-6)  # the last pivot is 1e-6
    assert solve(P, right, everything, 0.9e-6)[0]
    assert not solve(P, right, everything, 1.1e-6)[0]
    assert solve(P, right, np.arange(d) > 0, 1.1e-6)[0]
    P[0, 0] = -1.0
    assert not solve(P, right, everything)[0]
    P[0, 0] = np.nan
    assert not solve(P, right, everything)[0]
