"""Batches of box programs: the answers of single programs, whatever the other programs and the number of threads."""

import re
from collections.abc import Callable

import numpy as np
import pytest
from qpsolvers import Problem

import solvers
from solvers import BoxBatch
from solvers.arrays import Matrix
from solvers.core import OK


def programs(count: int, d: int, seed: int) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Random programs of condition up to 1e12, every kind of bound among them."""
    random = np.random.default_rng(seed)
    rows = random.normal(size=(count, 2 * d, d)) * 10.0 ** random.uniform(-6, 0, (count, 1, d)) ** random.integers(
        0, 2, (count, 1, 1)
    )
    P, target = np.einsum("bki,bkj->bij", rows, rows) / d, random.normal(size=(count, d))
    lb = np.where(random.random((count, d)) < 0.7, 0.0, -np.inf)
    ub = np.where(random.random((count, d)) < 0.2, 0.7, np.inf)
    lb, ub = np.where(random.random((count, d)) < 0.05, 0.2, lb), np.where(random.random((count, d)) < 0.05, 0.2, ub)
    return P, -np.einsum("bij,bj->bi", P, target), np.minimum(lb, ub), ub


@pytest.mark.parametrize("d", [1, 2, 7, 18, 60])
def test_every_answer_is_that_of_the_single_solver_to_the_bit(d: int) -> None:
    P, q, lb, ub = programs(27, d, d)
    x, found = BoxBatch(d).solve(P, q, lb, ub)
    assert found.all()
    for b in range(27):
        single = solvers.get("box_active_set")
        single.setup(Problem(P[b], q[b], lb=lb[b], ub=ub[b]))
        np.testing.assert_array_equal(x[b], single.solve())


ONE_P: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "definite": lambda P: P,
    "singular": np.ones_like,
    "nearly singular": lambda P: np.ones_like(P) + 1e-14 * np.eye(len(P)),
    "with a zero row": lambda P: P * np.outer(np.arange(len(P)) != 2, np.arange(len(P)) != 2),
    "indefinite": np.negative,
    "NaN": lambda P: np.full_like(P, np.nan),
}


@pytest.mark.parametrize("kind", ONE_P)
@pytest.mark.parametrize("count", [0, 1, 200])
def test_one_P_for_all_programs_has_the_answers_of_a_copy_for_each(count: int, kind: str) -> None:
    matrices, q, lb, ub = programs(max(count, 1), 7, 3)
    P = ONE_P[kind](matrices[0])
    lb[::5], ub[::5] = -1.0, 1.0
    q[3:4, 1], lb[7:8], ub[9:10, 0] = np.inf, 2.0, np.nan
    given = q[:count], lb[:count], ub[:count]
    together, separate = BoxBatch(7), BoxBatch(7)
    for one, other in zip(together.solve(P, *given), separate.solve(np.tile(P, (count, 1, 1)), *given), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(together.statuses, separate.statuses)
    assert (together.statuses[:1] == OK).all() == (count == 0 or kind not in ("indefinite", "NaN"))


def test_an_invalid_program_changes_no_bit_of_the_others() -> None:
    P, q, lb, ub = programs(21, 18, 0)
    x, _ = BoxBatch(18).solve(P, q, lb, ub)
    P[2, 3, 3], P[4, 0, 1], P[6, 5] = -1.0, np.inf, np.nan
    q[8, 1], lb[10, 0], ub[10, 0], lb[12, 2], P[14, 0, 1] = np.nan, 2.0, 1.0, np.nan, P[14, 0, 1] + 5.0
    P[16], q[16], lb[16], ub[16] = 0.0, 1.0, -np.inf, np.inf  # unbounded
    P[18], lb[18], ub[18] = np.outer(np.ones(18), np.ones(18)), -1.0, 1.0  # singular, with an optimum
    batch = BoxBatch(18, threads=2)
    spoiled, found = batch.solve(P, q, lb, ub)
    none = [2, 4, 6, 8, 10, 12, 14, 16]
    assert np.flatnonzero(~found).tolist() == none
    assert np.isnan(spoiled[none]).all()
    others = np.setdiff1d(np.arange(21), [*none, 18])
    np.testing.assert_array_equal(spoiled[others], x[others])
    assert "indefinite" in batch.reason(2)
    assert "finite" in batch.reason(8)
    assert "above its upper bound" in batch.reason(10)
    assert "not symmetric" in batch.reason(14)
    assert "unbounded" in batch.reason(16)
    assert batch.reason(18) == ""
    single = solvers.get("box_active_set")
    single.setup(Problem(P[18], q[18], lb=lb[18], ub=ub[18]))
    np.testing.assert_array_equal(spoiled[18], single.solve())


@pytest.mark.parametrize("count", [0, 1, 8, 333])
def test_threads_and_the_order_of_programs_change_no_bit(count: int) -> None:
    P, q, lb, ub = programs(count, 7, count)
    x, found = BoxBatch(7, threads=1).solve(P, q, lb, ub)
    assert x.shape == (count, 7)
    for threads in (2, 5):
        again, _ = BoxBatch(7, threads=threads).solve(P[::-1], q[::-1], lb[::-1], ub[::-1])
        np.testing.assert_array_equal(again[::-1], x)
    assert found.all()


def test_data_of_another_kind_are_copied_and_none_is_written_to() -> None:
    P, q, lb, ub = (
        np.tile(np.eye(2, dtype=int), (3, 1, 1)),
        np.full((3, 2), -1, np.float32),
        np.zeros((3, 2)),
        np.full((3, 2), 0.5),
    )
    for array in (P, q, lb, ub):
        array.flags.writeable = False
    x, _ = BoxBatch(2).solve(P, q, lb, ub)
    assert x.tolist() == [[0.5, 0.5]] * 3


@pytest.mark.parametrize(
    ("options", "change", "sentence"),
    [
        ((2,), {"P": lambda P: P[:2]}, "P must be of shape (3, 2, 2), and not (2, 2, 2)"),
        ((2,), {"P": lambda P: P[0, :1]}, "P must be of shape (2, 2), and not (1, 2)"),
        ((2,), {"lb": lambda lb: lb[:2]}, "lb must be of shape (3, 2), and not (2, 2)"),
        ((2,), {"q": lambda q: q.astype(complex)}, "q must be made of real numbers, and not of complex128"),
        ((2,), {"q": lambda q: 3.0}, "q must be of shape (0, 2), and not ()"),
        ((0,), {}, "a program has 1 to 1000 variables, and not 0"),
        ((2, 0), {}, "there must be at least one thread, and not 0"),
    ],
)
def test_an_invalid_batch_is_refused_in_a_sentence(options: tuple, change: dict, sentence: str) -> None:
    data = dict(zip(("P", "q", "lb", "ub"), programs(3, 2, 0), strict=True))
    with pytest.raises(ValueError, match=f"^{re.escape(sentence)}$"):
        BoxBatch(*options).solve(**{name: change.get(name, np.asarray)(array) for name, array in data.items()})
