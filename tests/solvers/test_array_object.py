"""Arrays that compiled code takes as Python hands them over."""

import pickle
import sys

import numpy as np
import pytest
from numba import njit

from solvers.array_object import NDARRAY, array_object, matrix, vector
from solvers.compiled import entry


@njit
def _last_of_matrix(x, array_class):
    a = matrix(x, array_class)
    return a.shape[0], a.shape[1], a[a.shape[0] - 1, a.shape[1] - 2] if a.size else 0.0


@njit
def _last_of_vector(x, array_class):
    a = vector(x, array_class)
    return a.shape[0], a[a.size - 1] if a.size else 0.0


last_of_matrix = entry(_last_of_matrix, array_object, NDARRAY)
last_of_vector = entry(_last_of_vector, array_object, NDARRAY)
A = np.arange(6.0).reshape(2, 3)


def locked(array):
    array.setflags(write=False)
    return array


@pytest.mark.parametrize("array", [A, pickle.loads(pickle.dumps(A)), locked(A.copy()), np.vstack([A, A])[2:]])
def test_a_contiguous_array_of_doubles_arrives_with_its_shape_and_numbers(array):
    assert last_of_matrix(array, NDARRAY) == (2, 3, 4.0)
    assert last_of_vector(array[1], NDARRAY) == (3, 5.0)


@pytest.mark.parametrize("other", [None, 3, "text", [[1.0, 2.0]], object(), np.ndarray, A.T, A[:, :2], A[::-1], A.astype(np.float32),
                                   A.astype(np.int64), A.astype(np.complex128)[:, :1], A.astype(">f8"), np.asfortranarray(A),
                                   np.ma.array(A), A[0, 0], np.array(1.0), A[None], np.frombuffer(b"1" * 49, offset=1).reshape(2, 3)],
                         ids=lambda other: type(other).__name__)
def test_anything_else_arrives_as_an_empty_array(other):
    assert last_of_matrix(other, NDARRAY) == (0, 0, 0.0)
    assert last_of_vector(other, NDARRAY) == (0, 0.0)


def test_an_array_of_other_dimensions_arrives_empty():
    assert last_of_matrix(A[0], NDARRAY) == (0, 0, 0.0)
    assert last_of_vector(A, NDARRAY) == (0, 0.0)


def test_a_call_keeps_no_reference():
    array = A.copy()
    before = sys.getrefcount(array)
    for _ in range(100):
        last_of_matrix(array, NDARRAY)
    assert sys.getrefcount(array) == before
