"""(4): V(w) = ½ wᵀP w + qᵀw + c, the mean square of the error (5) over the samples, accumulated as they arrive."""

import numpy as np
import pytest
from properties import given, settings, st
from random_models import Case, cases

from piezo_model.data_basis import DataBasis

BLOCK = 64
"""Number of rows per update."""


@settings(max_examples=60)
@given(cases(), st.integers(1, 3 * BLOCK), st.sampled_from([1.0, 0.999, 0.9, 0.3]))
def test_P_q_and_c_are_those_of_a_dense_computation_in_plain_numpy(case: Case, size: int, forgetting: float) -> None:
    x, y = case.recording(size)
    basis = DataBasis(case.structure, case.state, forgetting)
    basis.update(x, y)
    P, q, c = case.program(x, y, np.full(size, True), forgetting)
    scale = np.sqrt(np.outer(np.diag(P), np.diag(P))) + 1e-3
    assert np.max(np.abs(basis.P - P) / scale) < 1e-12
    np.testing.assert_allclose(basis.q, q, rtol=0, atol=1e-12 * (1 + np.abs(P).max()))
    assert basis.c == pytest.approx(c, rel=1e-12)
    np.testing.assert_array_equal(basis.P, basis.P.T)
