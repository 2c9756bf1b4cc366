"""The two-axis stage: structure, push-pull, coupling, chunks, and the loops behind the decoupling matrix."""

import numpy as np
import pytest

from piezo_model import ModelStructure, OperatorState, SelfLearningCompensator, plants
from piezo_model.signals import random_walk, staircase
from piezo_model.stage.axis import Axis
from piezo_model.stage.decoupling import estimate_decoupling
from piezo_model.stage.learning import SelfLearningStage
from piezo_model.stage.stage import Stage

TS = 1e-3
COUPLING = np.array([[1.0, 0.06], [-0.04, 0.97]])
CURVED = {"saturation": 0.0, "asymmetry": -0.1, "creep_share": 0.0}


def axis(name="relay_preisach", actuators=1, options=None, **more):
    made = tuple(plants.get(name, sample_time=TS, **(options or {})) for _ in range(actuators))
    return Axis(actuators=made, **{"natural_frequency_Hz": 100.0, "damping_ratio": 0.2, **more})


def stage(actuators=1, **options):
    return Stage(
        axes=(axis(actuators=actuators), axis("dense_prandtl_ishlinskii", actuators)),
        **{"coupling": COUPLING, "noise_um": 0.01, "quantum_um": 0.001, "seed": 3, **options},
    )


def wander(seconds=1.0, seed=0):
    return np.column_stack(
        [
            random_walk(duration_s=seconds, sample_time=TS, low=0.0, high=150.0, seed=seed + i, spread_per_root_s=3.0)
            for i in range(2)
        ]
    )


# Structure


def test_the_structure_rings_at_its_damped_frequency_and_decays_with_its_damping():
    ringing = axis(options={"creep_share": 0.0}, natural_frequency_Hz=20.0, damping_ratio=0.05)
    ringing.run(np.full(10, 0.0))
    p = ringing.run(np.full(2000, 150.0))
    final, step = ringing.y_range[1], np.ptp(ringing.y_range)
    t = (np.arange(p.size) + 1) * TS  # a sample is taken at the end of its period
    w, zeta = 2.0 * np.pi * 20.0, 0.05
    wd = w * np.sqrt(1.0 - zeta**2)
    expected = final - step * np.exp(-zeta * w * t) * (np.cos(wd * t) + zeta * w / wd * np.sin(wd * t))
    np.testing.assert_allclose(p, expected, atol=1e-6 * step)


@pytest.mark.parametrize("damping_ratio", [0.0, 0.3, 1.0, 2.5])
def test_the_discretisation_is_exact_so_halving_the_period_changes_nothing(damping_ratio):
    coarse, fine = (
        Axis(
            actuators=(plants.get("relay_preisach", sample_time=ts, creep_share=0.0),),
            natural_frequency_Hz=40.0,
            damping_ratio=damping_ratio,
        )
        for ts in (TS, TS / 2)
    )
    x = wander(0.3)[:, 0]
    np.testing.assert_allclose(fine.run(np.repeat(x, 2))[1::2], coarse.run(x), atol=1e-9)


def test_a_lever_multiplies_the_displacement():
    x = wander(0.3)[:, 0]
    np.testing.assert_allclose(axis(lever=3.0).run(x), 3.0 * axis().run(x), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("actuators", [1, 2])
def test_a_stage_at_rest_stays_where_it_is(actuators):
    p = axis(actuators=actuators).run(np.zeros(3000))
    assert np.ptp(p) < 1e-6


def test_drift_changes_the_stroke_by_the_stated_amount():
    ends = np.repeat(np.tile([0.0, 150.0], 10), 100)
    steady, drifting = (axis(options={"creep_share": 0.0}, gain_drift_per_s=drift).run(ends) for drift in (0.0, 0.1))
    at = np.arange(99, ends.size, 100)
    np.testing.assert_allclose(drifting[at], steady[at] * (1.0 + 0.1 * at * TS), rtol=2e-3)


# Push-pull


def test_push_pull_makes_the_loop_point_symmetric_unlike_one_actuator():
    swing = 75.0 + 75.0 * np.sin(2.0 * np.pi * np.arange(4000) * TS / 0.5)

    def asymmetry(actuators):
        p = axis("dense_prandtl_ishlinskii", actuators, CURVED).run(swing)[-500:]
        return np.abs(p + np.roll(p, 250)).max() / np.ptp(p)

    assert asymmetry(1) > 0.05
    assert asymmetry(2) < 1e-3


@pytest.mark.parametrize("name", plants.names())
def test_an_opposing_actuator_rests_at_the_other_end(name):
    single, pair = axis(name, 1, {"creep_share": 0.0}), axis(name, 2, {"creep_share": 0.0})
    low, high = (pair.run(np.full(500, x))[-1] for x in (0.0, 150.0))
    assert low == pytest.approx(-high, rel=0.05)
    assert pair.y_range == single.y_range  # which is symmetric already


# The sensor and the coupling


def test_the_seed_decides_the_noise_and_the_converter_its_steps():
    x = wander(0.2)
    np.testing.assert_array_equal(stage(seed=1).run(x), stage(seed=1).run(x))
    assert not np.array_equal(stage(seed=1).run(x), stage(seed=2).run(x))
    y = stage(quantum_um=0.5).run(x)
    np.testing.assert_array_equal(y, 0.5 * np.round(y / 0.5))


def test_the_coupling_mixes_the_axes():
    x = wander(0.3)
    quiet = stage(noise_um=0.0, quantum_um=0.0)
    alone = np.column_stack([each.run(x[:, i]) for i, each in enumerate(stage().axes)])
    np.testing.assert_allclose(quiet.run(x), alone @ COUPLING.T, atol=1e-12)


# Decoupling


def test_the_decoupling_is_found_from_a_recording_of_a_real_hysteretic_stage():
    x = wander(10.0)
    leak = estimate_decoupling(x, stage().run(x)) @ COUPLING
    assert np.abs(leak - np.diag(np.diag(leak))).max() < 0.01
    assert np.abs(COUPLING - np.diag(np.diag(COUPLING))).max() > 0.03


# Learning behind the decoupling matrix


def loops(one):
    learners = []
    for each in one.axes:
        structure = ModelStructure.equidistant(
            n=5, m=3, x_range=each.x_range, y_range=each.y_range, creep_rates=(10.0, 1.0), sample_time=TS, offset=True
        )
        learners.append(
            SelfLearningCompensator(
                structure,
                0.05,
                3.0,
                0.05,
                "box_active_set",
                each.x_range,
                solve_delay_samples=7,
                state=OperatorState.settled_at(structure, each.x_range[0], came_from="above"),
            )
        )
    return SelfLearningStage(learners, np.linalg.inv(one.C))


def reference(seconds):
    steps = staircase(duration_s=seconds + 0.5, sample_time=TS, low=-15.0, high=15.0, hold_s=0.1)
    smooth = np.convolve(steps, np.hanning(42)[1:-1] / np.hanning(42).sum(), "full")[: steps.size]
    return np.column_stack([smooth[:-500], smooth[500:]])


def test_both_axes_learn_behind_the_decoupling_matrix():
    one, y_ref = stage(), reference(12.0)
    y = loops(one).run(y_ref, one.run)[1]
    before, after = (
        np.sqrt(np.mean((y - y_ref)[part] ** 2, axis=0)) for part in (slice(500, 2500), slice(-2000, None))
    )
    assert (after < 0.1 * before).all()


def test_without_decoupling_an_axis_that_stands_still_is_disturbed_by_the_other():
    one, two, y_ref = stage(), stage(), reference(6.0)
    y_ref[:, 0] = 0.0
    blind = loops(two)
    blind.D = np.eye(2)
    right, wrong = (np.ptp(loop.run(y_ref, each.run)[1][-2000:, 0]) for loop, each in ((loops(one), one), (blind, two)))
    assert wrong > 0.04 * 30.0
    assert right < 0.1 * wrong


def test_the_loop_by_steps_equals_the_loop_in_chunks():
    one, two, y_ref = stage(), stage(), reference(4.0)
    whole = loops(one).run(y_ref, one.run)
    loop, y = loops(two), np.full(2, np.nan)
    for k, row in enumerate(y_ref):
        x = loop.step(row, y)
        y = two.step(x)
        np.testing.assert_array_equal(x, whole[0][k])
        np.testing.assert_array_equal(y, whole[1][k])
