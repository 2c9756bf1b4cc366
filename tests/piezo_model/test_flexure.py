import copy

import numpy as np
import pytest
from ringing_stage import RingingStage, T, steps

from piezo_model import Dynamics, plants

DYNAMICS = Dynamics((300.0,), (0.02,), (0.9,), 0.5 * T)


def stage() -> plants.Flexure:
    return plants.Flexure(plants.get("bouc_wen", sample_time=T), DYNAMICS)


def test_a_stage_in_a_flexure_moves_as_one_that_is_integrated_on_a_finer_grid() -> None:
    x = steps(4000, 1)
    expected = RingingStage("bouc_wen", [(300.0, 0.02, 0.9)], 0.0).run(x)
    exact = plants.Flexure(plants.get("bouc_wen", sample_time=T), Dynamics((300.0,), (0.02,), (0.9,), 0.0)).run(x)
    np.testing.assert_allclose(exact, expected, atol=1e-9)


def test_chunks_copies_and_a_reset_give_the_bits_of_one_run() -> None:
    x, one = steps(1000, 2), stage()
    whole = one.run(x)
    other = stage()
    first = other.run(x[:400])
    later = copy.copy(other)
    np.testing.assert_array_equal(np.concatenate([first, other.run(x[400:])]), whole)
    np.testing.assert_array_equal(later.run(x[400:]), whole[400:])
    one.reset()
    np.testing.assert_array_equal([one.step(value) for value in x[:50]], whole[:50])


@pytest.mark.parametrize(
    ("dynamics", "reason"),
    [
        (Dynamics((), (), (), 0.0, 1e-3), "without the lag of an amplifier"),
        (Dynamics((4000.0,), (0.1,), (1.0,), 0.0), "above 35 % of the sampling rate"),
    ],
)
def test_dynamics_that_a_stage_cannot_have_are_refused(dynamics: Dynamics, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        plants.Flexure(plants.get("bouc_wen", sample_time=T), dynamics)
