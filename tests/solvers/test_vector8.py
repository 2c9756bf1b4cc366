import numpy as np
import pytest
from numba import njit

from solvers.vector8 import LANES, load8, padded, splat8, store8, sum8

a = np.array([1.0, -2.0, 3.0, 0.0, -0.0, np.inf, 5e-324, 1e300])
b = np.array([0.5, -2.5, 3.0, -1.0, 0.0, 1.0, -5e-324, -np.inf])


@njit
def add(v, w):  # type: ignore[no-untyped-def]
    return v + w


@njit
def subtract(v, w):  # type: ignore[no-untyped-def]
    return v - w


@njit
def multiply(v, w):  # type: ignore[no-untyped-def]
    return v * w


@njit
def greater(v, w):  # type: ignore[no-untyped-def]
    return max(v, w)


@njit
def smaller(v, w):  # type: ignore[no-untyped-def]
    return min(v, w)


OPERATIONS = [add, subtract, multiply, greater, smaller]


@njit
def on_vectors(operation, v, w, out):  # type: ignore[no-untyped-def]
    store8(out, 0, operation(load8(v, 0), load8(w, 0)))


@njit
def on_vector_and_float(operation, v, x, out):  # type: ignore[no-untyped-def]
    store8(out, 0, operation(load8(v, 0), x))


@njit
def on_float_and_vector(operation, x, v, out):  # type: ignore[no-untyped-def]
    store8(out, 0, operation(x, load8(v, 0)))


@njit
def copy(source, at, target, to):  # type: ignore[no-untyped-def]
    store8(target, to, load8(source, at))


@njit
def fill(out, x):  # type: ignore[no-untyped-def]
    store8(out, 0, splat8(x))


@njit
def total(v):  # type: ignore[no-untyped-def]
    return sum8(load8(v, 0))


@pytest.mark.parametrize("operation", OPERATIONS)
def test_operators_work_lane_by_lane_with_the_bits_of_floats(operation) -> None:  # type: ignore[no-untyped-def]
    out = np.empty(LANES)
    on_vectors(operation, a, b, out)
    np.testing.assert_array_equal(out, [operation(v, w) for v, w in zip(a, b, strict=True)])
    np.testing.assert_array_equal(np.signbit(out), [np.signbit(operation(v, w)) for v, w in zip(a, b, strict=True)])


@pytest.mark.parametrize("operation", OPERATIONS)
@pytest.mark.parametrize("x", [1.5, -1.0, 0.0, np.inf])
def test_one_side_may_be_a_float(operation, x: float) -> None:  # type: ignore[no-untyped-def]
    left, right = np.empty(LANES), np.empty(LANES)
    on_float_and_vector(operation, x, b, left)
    on_vector_and_float(operation, b, x, right)
    np.testing.assert_array_equal(left, [operation(x, w) for w in b])
    np.testing.assert_array_equal(right, [operation(w, x) for w in b])


@pytest.mark.parametrize("operation", [greater, smaller])
def test_max_and_min_return_their_first_argument_beside_nan_as_floats_do(operation) -> None:  # type: ignore[no-untyped-def]
    nan, number, out = np.full(LANES, np.nan), np.full(LANES, 2.0), np.empty(LANES)
    for v, w in ((nan, number), (number, nan)):
        on_vectors(operation, v, w, out)
        np.testing.assert_array_equal(out, v)
        np.testing.assert_array_equal(operation(v[0], w[0]), v[0])
        np.testing.assert_array_equal(operation.py_func(v[0], w[0]), v[0])


def test_load_and_store_take_any_place_and_leave_the_neighbours_alone() -> None:
    source = np.arange(40.0)
    for at in range(32):
        target = np.full(40, -1.0)
        copy(source, at, target, 31 - at)
        expected = np.full(40, -1.0)
        expected[31 - at:39 - at] = source[at:at + 8]
        np.testing.assert_array_equal(target, expected)


def test_a_splat_has_the_value_in_every_lane_and_integers_become_floats() -> None:
    out = np.empty(LANES)
    for x in (0.1, -3, np.inf):
        fill(out, x)
        np.testing.assert_array_equal(out, np.full(LANES, float(x)))


def test_a_sum_adds_the_lanes_pairwise() -> None:
    v = np.random.default_rng(0).normal(size=8)
    assert total(v) == pytest.approx(v.sum(), rel=1e-14)
    assert total(np.array([1e16, 1.0, 0, 0, -1e16, 1.0, 0, 0])) == 2.0


def test_sizes_are_padded_to_the_next_block() -> None:
    assert [padded(size) for size in (0, 1, 7, 8, 9, 16, 17)] == [0, 8, 8, 8, 16, 16, 24]
