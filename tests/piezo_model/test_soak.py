"""Endurance over millions of samples."""

import pytest
from soak import DAY, LOOPS, PIECE, soak


@pytest.mark.nightly
@pytest.mark.parametrize("kind", LOOPS)
def test_error_and_memory_stay_as_they_are_and_a_day_uses_little_of_any_counter(kind: str) -> None:
    samples = 128 * PIECE
    found = soak(kind, samples, samples // 8)
    assert len(found.rms_um) == 8
    assert max(found.rms_um) < 1.05 * min(found.rms_um)
    assert found.resident[-1] - found.resident[0] < 2 * 2**20
    for name, (value, bits) in found.counters.items():
        assert value * (DAY / samples) < 0.01 * 2.0 ** (bits - 1), name
