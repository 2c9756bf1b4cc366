"""Simulated actuators: the contract of a plant, bare or with its sensor, the behaviour of a stack
actuator, laws that each simulated hysteresis obeys or violates, and the errors of a sensor."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import ALL
from ringing_stage import RingingStage, T, steps

from piezo_model import DataBasis, Dynamics, ModelStructure, plants
from piezo_model.plants.bouc_wen import BoucWen
from piezo_model.signals import decaying_triangle, multi_sine, random_walk

TS = 1e-3
NAMES = plants.names()
every_plant = pytest.mark.parametrize("name", NAMES)
bare = partial(plants.get, sample_time=TS)


def ramp(*turns, per_ramp=200):
    """Drive that visits the turning points, V."""
    return np.interp(np.arange((len(turns) - 1) * per_ramp + 1) / per_ramp, np.arange(len(turns)), turns)


def walk(seconds=2.0, seed=0):
    return random_walk(duration_s=seconds, sample_time=TS, low=0.0, high=150.0, seed=seed, spread_per_root_s=3.0)


def flexed(delay_s):
    return plants.Flexure(plants.get("bouc_wen", sample_time=T), Dynamics((300.0,), (0.02,), (0.9,), delay_s))


def measured(name):
    return plants.Sensor(
        bare(name),
        noise_um=0.01,
        quantum_um=0.001,
        gain_drift_per_s=1e-3,
        offset_um=0.3,
        delay_samples=3,
        seed=5,
    )


contract = pytest.mark.parametrize(
    ("make", "name"), [*((make, name) for make in (bare, measured) for name in NAMES), (flexed, 0.5 * T)]
)


def test_the_folder_is_the_registry():
    assert NAMES == ["bouc_wen", "dense_prandtl_ishlinskii", "duhem", "maxwell_slip", "relay_preisach"]


# The contract of a plant


@contract
@settings(max_examples=25 if ALL else 8, deadline=None)
@given(cuts=st.lists(st.integers(0, 600), max_size=6), seed=st.integers(0, 1000))
def test_a_run_in_chunks_and_single_steps_equals_one_run_bit_for_bit_and_another_after_a_reset(make, name, cuts, seed):
    x, plant = walk(0.6, seed), make(name)
    chunks = [plant.run(chunk) for chunk in np.split(x[:500], sorted(cuts))]
    steps = np.array([plant.step(v) for v in x[500:]])
    whole = make(name).run(x)
    np.testing.assert_array_equal(np.concatenate([*chunks, steps]), whole)
    plant.reset()
    np.testing.assert_array_equal(plant.run(x), whole)


@contract
@pytest.mark.parametrize(("x", "message"), [([[1.0]], "must be a vector"), ([1.0, np.nan], r"x\[1\] is not a finite")])
def test_a_bad_drive_is_refused_in_one_sentence_and_changes_nothing(make, name, x, message):
    plant = make(name)
    with pytest.raises(ValueError, match=message):
        plant.run(x)
    np.testing.assert_array_equal(plant.run(walk(0.1)), make(name).run(walk(0.1)))


# Behaviour of a stack actuator


@every_plant
@settings(max_examples=25 if ALL else 12, deadline=None)
@given(turns=st.lists(st.floats(-100.0, 300.0), min_size=1, max_size=12))
def test_the_displacement_stays_in_its_range_whatever_the_drive(name, turns):
    assert np.abs(bare(name).run(ramp(0.0, *turns))).max() <= 20.0 + 1e-9


@every_plant
@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (149.0, 150.0), (140.0, 150.0), (0.0, 40.0)])
def test_small_strokes_about_an_end_never_ratchet_out_of_the_range(name, low, high):
    assert np.abs(bare(name).run(ramp(0.0, 150.0, *(low, high) * 400, per_ramp=10))).max() <= 20.0 + 1e-9


@every_plant
def test_a_drive_beyond_the_range_is_limited_to_it(name):
    x = ramp(-50.0, 250.0, 20.0)
    np.testing.assert_array_equal(bare(name).run(x), bare(name).run(np.clip(x, 0.0, 150.0)))


@every_plant
def test_other_ranges_only_change_the_units(name):
    x = walk()
    y = plants.get(name, sample_time=TS, x_range=(-30.0, 30.0), y_range=(0.0, 100.0)).run(x * 0.4 - 30.0)
    np.testing.assert_allclose(y, 50.0 + 2.5 * bare(name).run(x), atol=1e-10)


@every_plant
def test_the_plant_rests_at_the_low_end(name):
    y = bare(name).run(np.zeros(2000))
    assert np.ptp(y) < 1e-9
    assert y[0] < -16.0


@every_plant
def test_the_major_loop_lags_and_has_the_width_of_a_stack_actuator(name):
    x = ramp(0.0, 150.0, 0.0, per_ramp=500)
    y = bare(name).run(np.tile(x, 3))[-x.size :]
    up, down = y[:501], y[500:][::-1]
    assert np.all(down[1:-1] > up[1:-1])
    assert -np.trapezoid(y, x) > 0.08 * 150.0 * np.ptp(y)
    assert 0.12 < (down - up).max() / np.ptp(y) < 0.155


@every_plant
def test_the_displacement_creeps_by_a_few_percent_and_by_about_as_much_each_decade(name):
    y = plants.get(name).run(np.r_[np.zeros(10), np.full(80_000, 100.0)])[9:]
    crept = (y - y[9]) / (y[9] - y[0])
    assert 0.02 < crept[-1] < 0.06
    decades = np.diff(crept[[80, 800, 8_000, 80_000]])
    assert np.all((decades > 0.005) & (decades < 0.02))


@every_plant
@settings(max_examples=25 if ALL else 12, deadline=None)
@given(turns=st.lists(st.floats(0.0, 150.0), min_size=1, max_size=8))
def test_every_branch_is_strictly_monotone(name, turns):
    x = ramp(0.0, *turns, 0.0, 150.0)
    y = plants.get(name, creep_share=0.0).run(x)
    dx = np.diff(x)
    moves = np.abs(dx) > 1e-9
    assert np.all(np.diff(y)[moves] * np.sign(dx[moves]) > 0.0)


@every_plant
@settings(max_examples=25 if ALL else 12, deadline=None)
@given(turns=st.lists(st.floats(0.0, 150.0), min_size=2, max_size=8))
def test_hysteresis_without_creep_does_not_know_the_speed(name, turns):
    slow, fast = (plants.get(name, creep_share=0.0).run(ramp(0.0, *turns, per_ramp=count)) for count in (300, 100))
    np.testing.assert_allclose(slow[::3], fast, atol=2e-6)


# Laws of the relay Preisach plane


def test_preisach_equals_a_plane_of_single_relays():
    x = ramp(0.0, 120.0, 30.0, 100.0, 60.0, 150.0, 20.0, 90.0, per_ramp=40)
    y = plants.get("relay_preisach", creep_share=0.0, lines=12).run(x)

    # Relay by relay, without plays: half widths r, centres s, and the density as the slope of the line's distribution.
    r = (np.arange(12)[:, None] + 0.5) / 12
    s = np.linspace(-1.0, 1.0, 8001)[None, :] * (1.0 - r)
    density = (1.0 + ((s - (0.15 - 0.5 * r)) / (1.1 - 0.6 * r)) ** 2) ** -1.5
    density *= np.exp(-r / 0.45) / density.sum(axis=1, keepdims=True)
    density /= density.sum()
    up, v = np.zeros(s.shape, dtype=bool), []
    for u in x / 75.0 - 1.0:
        up = (up | (u >= s + r)) & ~(u <= s - r)
        v.append(0.73 * u + 0.27 * (density[up].sum() - density[~up].sum()))
    np.testing.assert_allclose(y, 20.0 * np.array(v), atol=20.0 * 5e-4)


# Laws of Bouc-Wen


def test_bouc_wen_solves_its_equation():
    plant = BoucWen(creep_share=0.0, exponent=1.0)
    u = np.linspace(-1.0, 1.0, 1001)
    h = plant.stiffness * (u - plant.run(75.0 + 75.0 * u) / 20.0)
    # For n = 1 each side of h = 0 is a linear equation: dh/du = A + (β − γ) |h| below and A − (β + γ) h above.
    A, beta, gamma = plant.loading_slope, plant.beta, plant.gamma
    below = (A + (beta - gamma) * -h[0]) * np.exp(-(beta - gamma) * (u + 1.0))
    zero = -1.0 - np.log(A / (A + (beta - gamma) * -h[0])) / (beta - gamma)
    above = A * -np.expm1(-(beta + gamma) * (u - zero))
    exact = np.where(u < zero, (A - below) / (beta - gamma), above / (beta + gamma))
    np.testing.assert_allclose(h, exact, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("bouc_wen", 0.2, np.inf), ("relay_preisach", 0.0, 1e-10), ("dense_prandtl_ishlinskii", 0.0, 1e-10)],
)
def test_a_minor_loop_of_bouc_wen_does_not_close_and_those_of_the_others_do(name, least, most):
    plant = plants.get(name, creep_share=0.0)
    plant.run(ramp(0.0, 150.0, 60.0))
    loop = plant.run(ramp(60.0, 90.0, 60.0))
    assert least <= abs(loop[-1] - loop[0]) < most


# The plants are not in the model class


def residual_of_the_model_class(x, y, n, m):
    """Relative RMS of the unconstrained least-squares fit of the paper's equation (5), (4) at its least."""
    basis = DataBasis(
        ModelStructure.equidistant(n, m, (0.0, 150.0), (-20.0, 20.0), (100.0, 10.0, 1.0, 0.1), TS, offset=True)
    )
    basis.update(x, y)
    return np.sqrt(2.0 * basis.c - basis.q @ np.linalg.lstsq(basis.P, basis.q)[0]) / np.ptp(x / 75.0)


@every_plant
def test_a_model_of_the_papers_size_comes_near_and_leaves_a_residual_without_any_noise(name):
    x = np.concatenate(
        [
            decaying_triangle(duration_s=8.0, sample_time=TS, low=0.0, high=150.0),
            walk(8.0),
            multi_sine(duration_s=8.0, sample_time=TS, low=0.0, high=150.0, highest_Hz=10.0),
        ]
    )
    assert 5e-4 < residual_of_the_model_class(x, bare(name).run(x), n=5, m=3) < 5e-2


def test_the_residual_of_the_dense_plant_falls_as_the_model_grows():
    x = walk(20.0)
    y = bare("dense_prandtl_ishlinskii").run(x)
    small, large = (residual_of_the_model_class(x, y, n, m) for n, m in ((5, 3), (19, 9)))
    assert large < small / 3.0


def test_a_stage_in_a_flexure_moves_as_one_that_is_integrated_on_a_finer_grid():
    x = steps(4000, 1)
    finer = RingingStage("bouc_wen", [(300.0, 0.02, 0.9)])
    np.testing.assert_allclose(flexed(0.0).run(x), finer.run(x), atol=1e-9)


# The sensor of a plant: the size of each of its errors, and their repeatability


def resting():
    """A plant without creep, whose range is not symmetric."""
    return plants.get("bouc_wen", sample_time=TS, creep_share=0.0, y_range=(10.0, 50.0))


def added(size=50_000, **options):
    """Error of the sensor of a plant at rest."""
    still = np.zeros(size)
    return plants.Sensor(resting(), **options).run(still) - resting().run(still)


def test_the_noise_has_its_standard_deviation_and_is_white():
    m = added(noise_um=0.02, seed=1)
    assert (m.mean(), m.std()) == (pytest.approx(0.0, abs=5e-4), pytest.approx(0.02, rel=0.02))
    assert abs(np.corrcoef(m[1:], m[:-1])[0, 1]) < 0.02


def test_the_same_seed_gives_the_same_noise_and_another_seed_another():
    one, same, twice, other = (
        added(100, noise_um=size, seed=seed) for seed, size in ((1, 0.02), (1, 0.02), (1, 0.04), (2, 0.02))
    )
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)
    np.testing.assert_allclose(twice, 2.0 * one, rtol=1e-10)


def test_the_gain_drifts_about_the_centre_of_the_range():
    t, away = np.arange(3000) * TS, resting().run(np.zeros(3000)) - 30.0
    np.testing.assert_allclose(added(3000, gain_drift_per_s=0.01), away * 0.01 * t, atol=1e-12)


def test_the_measurement_is_the_nearest_multiple_of_the_quantum():
    x = walk()
    y = bare("relay_preisach").run(x)
    m = plants.Sensor(bare("relay_preisach"), quantum_um=0.05).run(x)
    np.testing.assert_allclose(m / 0.05, np.round(m / 0.05), atol=1e-9)
    assert np.abs(m - y).max() <= 0.025 + 1e-12
    assert (m - y).std() == pytest.approx(0.05 / np.sqrt(12.0), rel=0.1)


@pytest.mark.parametrize("options", [{}, {"delay_samples": 4}])
def test_a_measurement_is_the_displacement_or_an_earlier_one_that_starts_with_the_first(options):
    x, late = walk(), options.get("delay_samples", 0)
    y = bare("bouc_wen").run(x)
    expected = np.concatenate([np.full(late, y[0]), y[: y.size - late]])
    np.testing.assert_array_equal(plants.Sensor(bare("bouc_wen"), **options).run(x), expected)
