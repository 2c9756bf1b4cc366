from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plain_model import one_sided_dead_zones

from piezo_model.operators import creep, creep_gain, dead_zone, play

signals = st.lists(st.floats(-2, 2), min_size=1, max_size=40).map(np.array)
thresholds = st.lists(st.floats(0, 1.5), min_size=1, max_size=5).map(lambda values: np.sort(np.array(values)))
seeds = st.integers(0, 2**32 - 1)


def a_state(r: np.ndarray, x: float, seed: int) -> np.ndarray:
    return x + r * np.random.default_rng(seed).uniform(-1, 1, r.size)


def resampled(x: np.ndarray, seed: int) -> np.ndarray:
    """The same path at another speed: every step in random smaller steps, with waits."""
    rng, path = np.random.default_rng(seed), [x[:1]]
    for a, b in pairwise(x):
        path.append(a + (b - a) * np.sort(np.append(rng.uniform(0, 1, rng.integers(0, 4)), 1.0)))
        path.append(np.full(rng.integers(0, 3), b))
    return np.concatenate(path)


@given(signals, thresholds, seeds)
def test_play_forgets_the_speed_at_which_a_path_is_driven(x: np.ndarray, r: np.ndarray, seed: int) -> None:
    z = a_state(r, x[0], seed)
    fast, slow = play(x, r, z)[1], play(resampled(x, seed), r, z)[1]
    np.testing.assert_allclose(slow, fast, rtol=0, atol=1e-14)


@given(signals, thresholds, seeds)
def test_a_larger_swing_wipes_out_all_smaller_ones_before_it(x: np.ndarray, r: np.ndarray, seed: int) -> None:
    z = a_state(r, x[0], seed)
    low, high = x.min() - 2 * r[-1], x.max() + 2 * r[-1]
    extremes = np.array([low, high, low, 0.3])
    with_past, without = play(np.append(x, extremes), r, z)[0], play(extremes, r, np.full(r.size, low))[0]
    np.testing.assert_array_equal(with_past[-3:], without[-3:])


@given(st.floats(-1, 0), st.floats(0, 1), thresholds, seeds)
def test_minor_loops_between_the_same_extremes_are_congruent(low: float, high: float, r: np.ndarray, seed: int) -> None:
    loop = np.concatenate([np.linspace(low, high, 30), np.linspace(high, low, 30)])
    shapes = []
    for before in (2.0 + 2 * r[-1], -2.0 - 2 * r[-1]):  # two histories: from above and from below
        outputs = play(np.concatenate([[before], loop, loop]), r, np.full(r.size, before))[0][-60:]
        shapes.append(outputs - outputs[0])
    np.testing.assert_allclose(*shapes, rtol=0, atol=1e-14)


@given(signals, thresholds, seeds)
def test_play_stays_within_its_threshold_and_keeps_the_order_of_inputs(x: np.ndarray, r: np.ndarray, seed: int) -> None:
    z = a_state(r, x[0], seed)
    lower, upper = play(x, r, z)[0], play(x + np.random.default_rng(seed).uniform(0, 1, x.size), r, z)[0]
    assert np.all(np.abs(lower - x[:, None]) <= r + 1e-15)
    assert np.all(lower <= upper)


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0, 1.5), st.floats(0.01, 1e4), st.floats(1e-5, 1e-2))
def test_creep_at_a_held_input_is_the_exact_exponential(x: float, z: float, r: float, rate: float, Ts: float) -> None:
    outputs, last = creep(np.full(50, x), [r], [rate], Ts, [z])
    end = min(max(z, x - r), x + r)  # dz/dt = a·dz(x − z, r) comes to rest at the edge of the band around x
    np.testing.assert_allclose(outputs[:, 0], end + (z - end) * np.exp(-rate * Ts * np.arange(50)), rtol=0, atol=1e-13)
    np.testing.assert_allclose(last, end + (z - end) * np.exp(-rate * Ts * 50), rtol=0, atol=1e-13)


def test_creep_does_not_see_the_input_of_its_own_sample() -> None:
    a, b = (creep([0.0, 0.4, last], [0.0], [50.0], 1e-3, [0.1])[0] for last in (-1.0, 1.0))
    np.testing.assert_array_equal(a, b)


def test_two_short_sampling_periods_of_creep_are_one_long_one() -> None:
    x = np.repeat(np.random.default_rng(0).uniform(-1, 1, 30), 2)
    short, long = creep(x, [0.2], [30.0], 1e-3, [0.5])[0], creep(x[::2], [0.2], [30.0], 2e-3, [0.5])[0]
    np.testing.assert_allclose(short[::2], long, rtol=0, atol=1e-14)


def test_very_slow_creep_loses_no_digits() -> None:
    assert creep_gain([1e-9], 1e-6)[0] == pytest.approx(1e-15, rel=1e-14)


@given(signals, st.lists(st.floats(-1.5, 1.5), min_size=1, max_size=6).map(np.array))
def test_dead_zones_follow_their_definition(u: np.ndarray, r: np.ndarray) -> None:
    np.testing.assert_array_equal(dead_zone(u, r), one_sided_dead_zones(r, u))


@given(signals, thresholds, st.lists(st.integers(0, 40), max_size=4), seeds)
def test_chunks_of_a_signal_give_the_same_bits_as_the_whole(x: np.ndarray, r: np.ndarray, cuts: list[int], seed: int) -> None:
    rates = np.geomspace(1, 1000, r.size)
    for operator in (lambda x, z: play(x, r, z), lambda x, z: creep(x, r, rates, 1e-3, z)):
        z = first = a_state(r, x[0], seed)
        parts = []
        for chunk in np.split(x, sorted(min(cut, x.size) for cut in cuts)):
            out, z = operator(chunk, z)
            parts.append(out)
        whole, last = operator(x, first)
        np.testing.assert_array_equal(np.concatenate(parts), whole)
        np.testing.assert_array_equal(z, last)


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
