"""Eight box programs at once, beside single ones: equal, and whatever their neighbours in the lanes are."""

import numpy as np
import pytest
from numpy.typing import NDArray
from qpsolvers import Problem

import solvers
from solvers.core import INDEFINITE, NOT_FINITE, OK, bindings, block

Matrix = NDArray[np.float64]


def programs(count: int, d: int, seed: int) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Random programs of condition up to 1e6, a bound on each side now and then."""
    random = np.random.default_rng(seed)
    rows = random.normal(size=(count, 2 * d, d)) * 10.0 ** random.uniform(-3, 0, (count, 1, d))
    P, target = np.einsum("bki,bkj->bij", rows, rows) / d, random.normal(size=(count, d))
    lb = np.where(random.random((count, d)) < 0.7, 0.0, -np.inf)
    ub = np.where(random.random((count, d)) < 0.2, 0.7, np.inf)
    return P, -np.einsum("bij,bj->bi", P, target), lb, ub


def solve(P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> tuple[Matrix, NDArray[np.int32], int]:
    count, d = q.shape
    x, statuses = np.empty((count, d)), np.empty(count, np.int32)
    alone = bindings.box_many(
        q, P.reshape(count, d * d), lb, ub, x, statuses, block(bindings.box_many_bytes(d)), 0, count, 1
    )
    return x, statuses, alone


@pytest.mark.parametrize("d", [1, 2, 5, 18, 60])
def test_every_optimum_is_that_of_its_program_alone(d: int) -> None:
    P, q, lb, ub = programs(61, d, d)
    x, statuses, _ = solve(P, q, lb, ub)
    assert set(statuses.tolist()) == {OK}
    for b in range(61):
        single = solvers.get("box_active_set")
        single.setup(Problem(P[b], q[b], lb=lb[b], ub=ub[b]))
        answer = single.solve()
        cost, ours = (0.5 * v @ P[b] @ v + q[b] @ v for v in (answer, x[b]))
        assert abs(ours - cost) <= 1e-12 * abs(cost)
        assert np.all((x[b] >= lb[b]) & (x[b] <= ub[b]))


def test_what_is_wrong_with_one_program_changes_no_bit_of_the_others() -> None:
    P, q, lb, ub = programs(16, 18, 0)
    x, _, _ = solve(P, q, lb, ub)
    P[2, 3, 3], q[5, 1], P[9] = -1.0, np.nan, np.outer(np.ones(18), np.ones(18))
    spoiled, statuses, alone = solve(P, q, lb, ub)
    others = np.setdiff1d(np.arange(16), [2, 5, 9])
    np.testing.assert_array_equal(spoiled[others], x[others])
    assert (statuses[2], statuses[5]) == (INDEFINITE, NOT_FINITE)
    assert alone == 3
