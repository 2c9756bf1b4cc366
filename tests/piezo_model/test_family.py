"""Situations drawn at random: repeatable, of every kind, and such that a learner can do something with them."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from piezo_model import plants
from piezo_model.family import REFERENCES, Situation

T = 1e-3


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_a_seed_is_a_situation_in_which_the_reference_can_be_reached(seed: int) -> None:
    situation, again = (Situation.draw(seed, 12.0, T) for _ in range(2))
    assert (situation.plant, situation.actuator_options) == (again.plant, again.actuator_options)
    np.testing.assert_array_equal(situation.y_ref, again.y_ref)
    sensor, low_high = situation.sensor(), situation.x_limits
    y = sensor.run(np.interp(np.arange(4000), (0, 2000, 4000), (*low_high, low_high[0])))
    np.testing.assert_array_equal(again.sensor().run(np.interp(np.arange(4000), (0, 2000, 4000), (*low_high, low_high[0]))), y)
    assert np.nanmin(y) < situation.y_ref.min() + 0.02 * np.ptp(y[np.isfinite(y)])
    assert np.nanmax(y) > situation.y_ref.max()
    assert situation.structure().d == 19


def test_every_kind_of_actuator_and_reference_is_drawn_and_individuals_differ() -> None:
    drawn = [Situation.draw(seed, 1.0, T) for seed in range(60)]
    assert {situation.plant for situation in drawn} == set(plants.names())
    assert {situation.reference for situation in drawn} == set(REFERENCES)
    assert len(plants.names()) >= 5
    assert len(REFERENCES) >= 7
    assert len({tuple(situation.actuator_options.items()) for situation in drawn}) == len(drawn)


def test_a_chosen_reference_changes_nothing_but_the_reference() -> None:
    one, other = Situation.draw(3, 1.0, T, "staircase"), Situation.draw(3, 1.0, T, "random_walk")
    assert (one.plant, one.actuator_options, one.x_range, one.y_range) == (other.plant, other.actuator_options, other.x_range, other.y_range)
    assert one.guessed(2.0).x_range[1] - one.guessed(2.0).x_range[0] == 2.0 * (one.x_range[1] - one.x_range[0])
