"""(1): H[x] = Σ w_Hi H_rHi[x], a sum of plays that obeys the laws of Prandtl and Ishlinskii, and S, a sum of one-sided
dead zones; (2): y = S[H[x] + K[x]], where each elementary creep operator is the exact solution of
dz/dt = a·dz(x − z, r) for a held input."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from plain_model import hysteresis_and_creep, one_sided_dead_zones, superposition
from random_models import Case, a_state, cases, drive, seeds, signals, thresholds

from piezo_model.model import HysteresisCreepModel
from piezo_model.operators import creep, dead_zone, play


def resampled(x: np.ndarray, seed: int) -> np.ndarray:
    """The same path at another speed: every step is split into random smaller steps and rests."""
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


@given(signals, st.lists(st.floats(-1.5, 1.5), min_size=1, max_size=6).map(np.array))
def test_dead_zones_follow_their_definition(u: np.ndarray, r: np.ndarray) -> None:
    np.testing.assert_array_equal(dead_zone(u, r), one_sided_dead_zones(r, u))


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


@given(cases())
def test_simulation_is_equation_2_as_plain_numpy_computes_it(case: Case) -> None:
    s, model, z = case.structure, case.model, case.state
    x, size = drive(case.rng, 80), case.structure.n + 1
    H, K = hysteresis_and_creep(s.to_dict(), x, z.play[:size], z.creep.reshape(-1, s.lanes)[:, :size])
    u = H @ model.w_H + model.offset + (K @ model.w_K if s.creep_rates else 0.0)
    expected = s.y_centre + s.y_scale * superposition(s.to_dict(), model.w_S_inverse, u)
    y = model.simulate(s.x_centre + s.x_scale * x, z.copy())
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-11 * s.y_scale + 1e-12 * abs(s.y_centre))


@given(cases())
def test_the_unknowns_of_the_identification_make_the_same_model_when_the_first_weight_is_one(case: Case) -> None:
    again = HysteresisCreepModel.from_weights(case.structure, case.model.weights)
    np.testing.assert_allclose(again.weights, case.model.weights, rtol=1e-15)
    x = case.structure.x_centre + drive(case.rng, 30)  # a common factor in w_H, w_K, offset and S⁻¹ does not show
    np.testing.assert_allclose(
        again.simulate(x, case.state),
        case.model.simulate(x, case.state),
        rtol=0,
        atol=1e-11 * case.structure.y_scale + 1e-12 * abs(case.structure.y_centre),
    )
