"""Situations drawn at random: repeatable, of every kind, and such that a learner can do something with them; learning
in them ends near the floor and is never worse than the straight line."""

import numpy as np
import pandas as pd
import pytest
import robustness
from disturbed_sensor import DisturbedSensor
from hypothesis import given, settings
from hypothesis import strategies as st
from references import changing_amplitude, from_samples, set_point_steps
from situations import REFERENCES, Situation

from piezo_model import plants

T = 1e-3


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_a_seed_is_a_situation_in_which_the_reference_can_be_reached(seed: int) -> None:
    situation, again = (Situation.draw(seed, 12.0, T) for _ in range(2))
    assert (situation.plant, situation.actuator_options) == (again.plant, again.actuator_options)
    low, high = situation.x_limits
    x = np.interp(np.arange(4000), (0, 2000, 4000), (low, high, low))
    y = situation.sensor().run(x)
    for one, same in ((situation.y_ref, again.y_ref), (y, again.sensor().run(x))):
        np.testing.assert_array_equal(one, same)
    assert np.nanmin(y) < situation.y_ref.min() + 0.02 * np.ptp(y[np.isfinite(y)])
    assert np.nanmax(y) > situation.y_ref.max()
    assert situation.structure().d == 19


def test_the_disturbances_of_a_sensor_have_their_sizes_however_a_run_is_cut() -> None:
    x, t = np.repeat([0.0, 150.0], [100, 900]), T * np.arange(900)
    plain, swinging, lagging, gapped = (
        DisturbedSensor(plants.get("duhem", sample_time=T, creep_share=0.0), **options)
        for options in ({}, {"gain_swing": 0.1}, {"lag_s": 0.05}, {"gap_samples": 3, "gap_period_samples": 50})
    )
    y, m = plain.run(x), np.concatenate([lagging.run(part) for part in np.split(x, [1, 333])])
    np.testing.assert_allclose((y - m)[100:] / np.ptp(y), np.exp(-(t + T) / 0.05), atol=1e-9)
    swing = 1.0 + 0.1 * np.sin(0.2 * np.pi * T * np.arange(1000))
    np.testing.assert_allclose(swinging.run(x), swing * y, atol=1e-9)
    assert np.flatnonzero(np.isnan(gapped.run(x))).tolist() == [k for k in range(1000) if k % 50 >= 47]


def test_every_kind_of_actuator_and_reference_is_drawn_and_individuals_differ() -> None:
    drawn = [Situation.draw(seed, 1.0, T) for seed in range(60)]
    assert {situation.plant for situation in drawn} == set(plants.names())
    assert {situation.reference for situation in drawn} == set(REFERENCES)
    assert len(plants.names()) >= 5
    assert len(REFERENCES) >= 7
    assert len({tuple(situation.actuator_options.items()) for situation in drawn}) == len(drawn)


def test_a_chosen_reference_changes_nothing_but_the_reference() -> None:
    one, other = Situation.draw(3, 1.0, T, "staircase"), Situation.draw(3, 1.0, T, "random_walk")
    assert (one.plant, one.actuator_options, one.x_range, one.y_range) == (
        other.plant,
        other.actuator_options,
        other.x_range,
        other.y_range,
    )


@settings(max_examples=20, deadline=None)
@given(low=st.floats(-1e3, 1e3), width=st.floats(1e-3, 1e3), seconds=st.floats(0.05, 3.0), seed=st.integers(0, 2**31))
def test_every_reference_stays_inside_its_limits(low: float, width: float, seconds: float, seed: int) -> None:
    options = {"duration_s": seconds, "sample_time": 1e-3, "low": low, "high": low + width}
    for s in (
        set_point_steps(**options, seed=seed),
        changing_amplitude(**options, seed=seed),
        from_samples(np.random.default_rng(seed).normal(size=9), **options),
    ):
        assert s.shape == (round(seconds / 1e-3),)
        assert s.min() >= low
        assert s.max() <= low + width


def test_set_points_are_held_for_their_mean_time_and_no_step_is_a_jump() -> None:
    s = set_point_steps(duration_s=200.0, sample_time=1e-3, low=0.0, high=1.0, seed=1, mean_hold_s=0.5, step_s=0.02)
    moves = np.flatnonzero(np.diff((np.abs(np.diff(s)) > 1e-9).astype(int)) == 1)
    assert moves.size == pytest.approx(400, rel=0.15)
    assert np.max(np.abs(np.diff(s))) < 0.12


def test_every_piece_has_an_amplitude_of_its_own() -> None:
    s = changing_amplitude(duration_s=40.0, sample_time=1e-3, low=-1.0, high=1.0, seed=4, piece_s=5.0, frequency_Hz=2.0)
    spans = [np.ptp(piece[500:]) for piece in np.split(s, 8)]
    assert max(spans) > 2.0 * min(spans)
    assert min(spans) > 0.3 * 0.95


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    return pd.DataFrame([row for seed in (5, 6, 14) for row in robustness.rows(seed)])


def test_every_way_ends_near_the_floor_and_far_from_the_straight_line(rows: pd.DataFrame) -> None:
    assert (rows.cycle_5 < 0.5 * rows.straight).all()
    assert (rows.ratio < 3.0).all()
    assert (rows[rows.way == "continuous"].ratio < 1.5).all()
