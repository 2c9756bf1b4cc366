"""Drive and reference signals: limits, repeatability, and the documented shape of each one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezo_model.signals import SIGNALS, decaying_triangle, excitation, multi_sine, random_walk, staircase

SEEDED = random_walk, multi_sine
TWO_SECONDS = {"duration_s": 2.0, "sample_time": 1e-3, "low": -20.0, "high": 130.0}


@pytest.mark.parametrize("name", SIGNALS)
@settings(max_examples=20, deadline=None)
@given(low=st.floats(-1e3, 1e3), width=st.floats(1e-3, 1e3), seconds=st.floats(0.05, 3.0), seed=st.integers(0, 2**31))
def test_every_signal_stays_inside_its_limits_and_is_a_pure_function_of_its_arguments(name, low, width, seconds, seed):
    options = {"duration_s": seconds, "sample_time": 1e-3, "low": low, "high": low + width}
    options |= {"seed": seed} if SIGNALS[name] in SEEDED else {}
    s, again = (SIGNALS[name](**options) for _ in range(2))
    assert (s.shape, s.dtype) == ((round(seconds / 1e-3),), np.float64)
    assert low <= s.min() <= s.max() <= low + width
    np.testing.assert_array_equal(s, again)


@pytest.mark.parametrize("function", SEEDED)
def test_another_seed_gives_another_signal(function):
    assert not np.array_equal(function(**TWO_SECONDS, seed=1), function(**TWO_SECONDS, seed=2))


def test_a_staircase_holds_each_level_and_goes_up_and_down_by_one_level():
    s = staircase(**TWO_SECONDS, levels=4, hold_s=0.1).reshape(-1, 100)
    assert np.ptp(s, axis=1).max() == 0.0
    np.testing.assert_allclose(s[:8, 0], [-20.0, 30.0, 80.0, 130.0, 80.0, 30.0, -20.0, 30.0])


def test_a_decaying_triangle_touches_both_limits_and_then_each_turning_point_is_inside_the_last():
    s = decaying_triangle(**TWO_SECONDS, cycles=5)
    assert (s[0], s.max(), s[-1]) == (-20.0, pytest.approx(130.0), pytest.approx(55.0, abs=0.2))
    turns = s[1:-1][np.diff(np.sign(np.diff(s))) != 0]
    assert turns.size >= 9
    assert np.all(np.diff(np.abs(turns - 55.0)) < 0.0)
    assert np.ptp(decaying_triangle(**TWO_SECONDS, cycles=40, final_share=0.5)[-50:]) == pytest.approx(75.0, rel=0.1)


def test_a_multi_sine_has_its_energy_at_its_log_spaced_tones_in_the_phases_of_schroeder_and_nowhere_else():
    s = multi_sine(duration_s=8.0, sample_time=1e-3, low=0.0, high=1.0, tones=4, lowest_Hz=1.0, highest_Hz=64.0)
    power = np.abs(np.fft.rfft(s - s.mean())) ** 2
    assert sorted((np.argsort(power)[-4:] / 8.0).tolist()) == [1.0, 4.0, 16.0, 64.0]
    assert np.sort(power)[-4:].sum() > 0.999 * power.sum()
    assert (s.min(), s.max()) == (0.0, 1.0)
    tones = np.fft.rfft(s)[[8, 32, 128, 512]]
    phases = np.exp(-1j * np.pi * np.array([0.0, 2.0, 6.0, 12.0]) / 4)  # of Schroeder
    np.testing.assert_allclose(tones * 1j / np.abs(tones), phases, atol=1e-6)


def test_an_excitation_begins_at_rest_and_holds_two_levels_for_a_sixth_of_its_duration_each():
    s = excitation(duration_s=6.0, sample_time=1e-3, low=-20.0, high=130.0)
    assert (s.size, np.argmax(s > -20.0 + 1e-6)) == (6000, 121)
    assert [np.sum(np.abs(s - level) < 1e-9) for level in (10.0, 100.0)] == pytest.approx([1000, 1000], abs=10)


def test_a_random_walk_starts_at_the_centre_roams_the_range_and_is_band_limited():
    s = random_walk(duration_s=60.0, sample_time=1e-3, low=0.0, high=150.0, seed=3, bandwidth_Hz=20.0)
    assert s[0] == pytest.approx(75.0)
    assert np.ptp(s) > 120.0
    power = np.abs(np.fft.rfft(np.diff(s) * np.hanning(s.size - 1))) ** 2
    assert power[200 * 60 :].sum() < 1e-3 * power.sum()
