import numpy as np
import pytest

from piezo_model.operators import creep, creep_gain, dead_zone, play


def test_very_slow_creep_loses_no_digits() -> None:
    assert creep_gain([1e-9], 1e-6)[0] == pytest.approx(1e-15, rel=1e-14)


def test_states_handed_in_are_not_written_to_and_strided_inputs_are_taken() -> None:
    z = np.array([0.1, 0.2])
    backward = np.linspace(-1, 1, 21)[::-2]
    np.testing.assert_array_equal(play(backward, [0.1, 0.3], z)[0], play(backward.copy(), [0.1, 0.3], z)[0])
    creep(backward, [0.1, 0.3], [1.0, 2.0], 1.0, z)
    assert z.tolist() == [0.1, 0.2]


def test_a_sample_that_is_not_a_number_leaves_the_state_where_it_is() -> None:
    assert play([np.nan], [0.1], [0.3])[1] == [0.3]
    assert creep([np.nan], [0.1], [1.0], 1e-3, [0.3])[1] == [0.3]
    assert dead_zone([np.nan], [-0.5, 0.0, 0.5]).tolist() == [[0.0, 0.0, 0.0]]
