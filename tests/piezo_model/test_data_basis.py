import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_models import Case, cases

from piezo_model import DataBasis, ModelStructure

BLOCK = 64
"""Number of rows per update."""


@settings(max_examples=60)
@given(cases(), st.sampled_from([1.0, 0.99]))
def test_any_chunking_gives_the_same_bits_and_a_missing_output_counts_like_one_that_is_not_counted(
    case: Case, forgetting: float
) -> None:
    x, y = case.recording(5 * BLOCK)
    counted = case.rng.random(x.size) < 0.9
    counted[:BLOCK], counted[-7:] = case.rng.random() < 0.5, True
    whole, parts = (DataBasis(case.structure, case.state, forgetting) for _ in range(2))
    out = case.structure.unit_output(y[counted])
    whole.update(x, np.where(counted, y, np.nan))
    cuts = np.union1d(np.flatnonzero(np.diff(counted)) + 1, case.rng.integers(0, x.size, 9))
    for a, b, count in zip(np.split(x, cuts), np.split(y, cuts), np.split(counted, cuts), strict=True):
        parts.update(a, b, count=bool(count.all()) if count.size else False)
        if parts.samples:
            parts.problem()  # reading the basis midway changes nothing
    for name in ("P", "q", "c", "samples", "excitation"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    np.testing.assert_equal(vars(parts.state), vars(whole.state))
    assert whole.samples == out.size
    assert (whole.excitation.y_min, whole.excitation.y_max) == (out.min(), out.max())
    P, _, _ = case.program(x, y, counted, forgetting)
    np.testing.assert_allclose(whole.P, P, rtol=0, atol=1e-12 * (1 + np.abs(P).max()))


@pytest.mark.parametrize("offset", [False, True])
def test_memory_does_not_grow_with_the_recording(offset: bool) -> None:
    s = ModelStructure.equidistant(
        n=20, m=8, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(9.0, 3.0), sample_time=1e-2, offset=offset
    )
    x, basis = np.sin(np.arange(2000) / 20), DataBasis(s)
    basis.update(x, x)
    peaks = []
    tracemalloc.start()
    for chunks in (5, 95):
        for _ in range(chunks):
            basis.update(x, x)
        peaks.append(tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
    assert peaks[1] - peaks[0] < 0.1 * 95 * 2 * x.nbytes  # a tenth of the additional samples
    assert basis.samples == 101 * 2000


SMALL = ModelStructure.equidistant(n=2, m=1, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(1.0,), sample_time=1e-2)


@pytest.mark.parametrize(
    ("x", "y", "sentence"),
    [
        ([1.0, 2.0], [1.0], r"same length, not of shapes \(2,\) and \(1,\)"),
        ([[1.0]], [[1.0]], r"vectors of the same length, not of shapes \(1, 1\)"),
        ([1.0, np.nan, 2.0], [1.0, 1.0, 1.0], r"x\[1\] is not a finite number"),
        ([1.0, 1.0], [1.0, -np.inf], r"y\[1\] is not a finite number"),
    ],
)
@pytest.mark.parametrize("count", [True, False])
def test_bad_samples_are_refused_in_one_sentence_and_nothing_is_taken(
    x: list, y: list, sentence: str, count: bool
) -> None:
    basis, other = DataBasis(SMALL), DataBasis(SMALL)
    for each in (basis, other):
        each.update([0.3, 0.9], [0.1, 0.2])
    with pytest.raises(ValueError, match=sentence):
        basis.update(x, y, count=count)
    np.testing.assert_array_equal(basis.P, other.P)
    np.testing.assert_array_equal(basis.state.play, other.state.play)
