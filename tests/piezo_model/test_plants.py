"""Simulated actuators: the contract of a plant, bare or with its sensor, and the behaviour of a stack actuator."""

import copy

import numpy as np
import pytest
from driven_plants import NAMES, TS, bare, every_plant, ramp, volts, walk
from hypothesis import given, settings
from hypothesis import strategies as st
from test_stage import stage, wander

from piezo_model import plants


def measured(name):
    return plants.Sensor(
        plants.get(name, sample_time=TS),
        noise_um=0.01,
        quantum_um=0.001,
        gain_drift_per_s=1e-3,
        gain_swing=0.02,
        gain_swing_period_s=0.7,
        offset_um=0.3,
        delay_samples=3,
        lag_s=2e-3,
        gap_samples=7,
        gap_period_samples=90,
        seed=5,
    )


PLANTS = [(make, name) for make in (bare, measured) for name in NAMES]
contract = pytest.mark.parametrize(("make", "name"), PLANTS)
with_stages = pytest.mark.parametrize(("make", "name"), [*PLANTS, (stage, 1), (stage, 2)])


def drive(make, seconds=2.0, seed=0):
    return (wander if make is stage else walk)(seconds, seed)


def test_the_folder_is_the_registry():
    assert NAMES == ["bouc_wen", "dense_prandtl_ishlinskii", "duhem", "maxwell_slip", "relay_preisach"]


def test_an_unknown_plant_is_refused_with_the_known_ones():
    with pytest.raises(KeyError, match="known are bouc_wen"):
        plants.get("stack")


# The contract of a plant


@with_stages
@settings(max_examples=15, deadline=None)
@given(cuts=st.lists(st.integers(0, 600), max_size=6), seed=st.integers(0, 1000))
def test_a_run_in_chunks_equals_one_run_bit_for_bit(make, name, cuts, seed):
    x = drive(make, 0.6, seed)
    whole = make(name).run(x)
    plant = make(name)
    chunks = [plant.run(chunk) for chunk in np.split(x, sorted(cuts))]
    np.testing.assert_array_equal(np.concatenate(chunks), whole)


@with_stages
def test_steps_equal_a_run_bit_for_bit(make, name):
    x = drive(make, 0.3)
    plant = make(name)
    np.testing.assert_array_equal([plant.step(v) for v in x], make(name).run(x))


@with_stages
def test_a_copy_goes_on_by_itself_with_the_same_bits(make, name):
    x, plant = drive(make), make(name)
    whole = plant.run(x)
    plant = make(name)
    plant.run(x[:700])
    for each in (copy.deepcopy(plant), plant):
        np.testing.assert_array_equal(each.run(x[700:]), whole[700:])


@contract
def test_a_reset_plant_is_as_made(make, name):
    x, plant = walk(), make(name)
    whole = plant.run(x)
    plant.reset()
    np.testing.assert_array_equal(plant.run(x), whole)


@contract
@pytest.mark.parametrize(("x", "message"), [([[1.0]], "must be a vector"), ([1.0, np.nan], r"x\[1\] is not a finite")])
def test_a_bad_drive_is_refused_in_one_sentence_and_changes_nothing(make, name, x, message):
    plant = make(name)
    with pytest.raises(ValueError, match=message):
        plant.run(x)
    np.testing.assert_array_equal(plant.run(walk(0.1)), make(name).run(walk(0.1)))


COMMON = [
    ("x_range", (1.0, 1.0)),
    ("y_range", (0.0, np.nan)),
    ("sample_time", 0.0),
    ("creep_share", 1.0),
    ("creep_rates_per_s", ()),
    ("creep_rates_per_s", (1.0, -1.0)),
]
"""Common options with invalid values."""


@pytest.mark.parametrize(
    ("name", "option", "value"),
    [
        *((name, option, value) for name in NAMES for option, value in COMMON),
        ("relay_preisach", "lines", 0),
        ("relay_preisach", "reversible_share", 1.0),
        ("relay_preisach", "hill_breadth", 0.0),
        ("relay_preisach", "hill_breadth_slope", 2.0),
        ("bouc_wen", "loading_slope", 0.0),
        ("bouc_wen", "beta", 0.0),
        ("bouc_wen", "gamma", 9.0),
        ("bouc_wen", "exponent", 0.5),
        ("bouc_wen", "stiffness", 0.1),
        ("dense_prandtl_ishlinskii", "thresholds", 1),
        ("dense_prandtl_ishlinskii", "saturation", 0.5),
        ("dense_prandtl_ishlinskii", "asymmetry", -0.5),
        ("dense_prandtl_ishlinskii", "threshold_scale", np.inf),
        ("maxwell_slip", "sliders", 0),
        ("maxwell_slip", "slip_share", 1.0),
        ("maxwell_slip", "reach", 2.5),
        ("maxwell_slip", "saturation", 0.5),
        ("duhem", "alpha", 0.0),
        ("duhem", "slope_after_turn", 0.5),
        ("duhem", "asymmetry", 0.6),
    ],
)
def test_an_actuator_refuses_a_wrong_option_by_its_name(name, option, value):
    with pytest.raises(ValueError, match=option):
        plants.get(name, **{option: value})


# Behaviour of a stack actuator


@every_plant
@settings(max_examples=25, deadline=None)
@given(turns=st.lists(st.floats(-100.0, 300.0), min_size=1, max_size=12))
def test_the_displacement_stays_in_its_range_whatever_the_drive(name, turns):
    y = plants.get(name, sample_time=TS, y_range=(0.0, 40.0)).run(ramp(0.0, *turns))
    assert y.min() >= -1e-9
    assert y.max() <= 40.0 + 1e-9


@every_plant
@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (149.0, 150.0), (140.0, 150.0), (0.0, 40.0)])
def test_small_strokes_about_an_end_never_ratchet_out_of_the_range(name, low, high):
    y = bare(name).run(ramp(0.0, 150.0, *(low, high) * 400, per_ramp=10))
    assert np.abs(y).max() <= 20.0 + 1e-9


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
    area = -np.trapezoid(y, x)
    assert area > 0.08 * 150.0 * np.ptp(y)
    assert 0.12 < (down - up).max() / np.ptp(y) < 0.155


@every_plant
def test_the_displacement_creeps_by_a_few_percent_and_by_about_as_much_each_decade(name):
    plant = plants.get(name)
    low = plant.run(np.zeros(10))[-1]
    y = plant.run(np.full(80_000, 100.0))
    step = y[8] - low
    assert 0.02 < (y[-1] - y[8]) / step < 0.06
    decades = np.diff(y[[79, 799, 7_999, 79_999]]) / step
    assert np.all((decades > 0.005) & (decades < 0.02))


@every_plant
def test_without_creep_a_held_drive_holds_the_displacement(name):
    y = plants.get(name, creep_share=0.0).run(np.full(1000, 100.0))
    assert np.ptp(y) == 0.0


@every_plant
@settings(max_examples=25, deadline=None)
@given(turns=st.lists(volts, min_size=1, max_size=8))
def test_every_branch_is_strictly_monotone(name, turns):
    x = ramp(0.0, *turns, 0.0, 150.0)
    y = plants.get(name, creep_share=0.0).run(x)
    dx = np.diff(x)
    moves = np.abs(dx) > 1e-9
    assert np.all(np.diff(y)[moves] * np.sign(dx[moves]) > 0.0)


@every_plant
@settings(max_examples=25, deadline=None)
@given(turns=st.lists(volts, min_size=2, max_size=8))
def test_hysteresis_without_creep_does_not_know_the_speed(name, turns):
    slow = plants.get(name, creep_share=0.0).run(ramp(0.0, *turns, per_ramp=300))
    fast = plants.get(name, creep_share=0.0).run(ramp(0.0, *turns, per_ramp=100))
    np.testing.assert_allclose(slow[::3], fast, atol=2e-6)
