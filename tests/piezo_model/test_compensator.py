"""The compensator: its states and starts, a drive that is finite and inside its limits whatever the reference is, and
integral action beside it."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from learning_loops import MODES, T, learner_for, sensor, spoiled, steps, structure_for
from random_models import FREE, Case, cases, drive

from piezo_model import (
    CompensatorBank,
    Dynamics,
    HysteresisCreepModel,
    ModelStructure,
    SelfLearningCompensator,
)
from piezo_model.compensator import BUMP, CORRECTION, Compensator


@settings(max_examples=40)
@given(cases())
def test_the_states_are_those_of_the_actuator_that_saw_the_limited_drive(case: Case) -> None:
    s = case.structure
    limits = (s.x_centre - 0.3 * s.x_scale, s.x_centre + 0.4 * s.x_scale)
    compensator = Compensator(case.model, limits, 0.05 * s.x_scale / s.sample_time, case.state)
    actuator, known = case.model.advance(compensator.run(case.reference()), case.state)[1], compensator.state
    np.testing.assert_allclose(np.r_[known.play, known.creep], np.r_[actuator.play, actuator.creep], rtol=0, atol=1e-12)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@settings(max_examples=20)
@given(case=cases(), where=st.integers(0, 39))
def test_a_reference_that_is_not_finite_holds_the_drive(bad: float, case: Case, where: int) -> None:
    others = np.arange(40) != where
    y_ref = np.where(others, case.reference(40), bad)
    x = Compensator(case.model, FREE, state=case.state).run(y_ref)
    before = x[where - 1] if where else case.structure.x_centre + case.structure.x_scale * case.state.play[0]
    assert np.all(np.isfinite(x))
    assert x[where] == pytest.approx(before, rel=0, abs=case.x_tolerance)
    np.testing.assert_allclose(case.model.simulate(x, case.state)[others], y_ref[others], rtol=0, atol=case.y_tolerance)


RANGED = ModelStructure.equidistant(n=2, m=1, x_range=(0, 100), y_range=(-10, 10), creep_rates=(1.0,), sample_time=1e-3)
LINE = HysteresisCreepModel.from_weights(RANGED, RANGED.straight_line)


def first_drives(y_ref: float, model: HysteresisCreepModel = LINE, **start: float | None) -> list[float]:
    """The first drive of everything that drives, at a rate limit of 0.1 V a sample."""
    s, limits = model.structure, {"rate_limit": 100.0, **start}
    return [
        Compensator(model, **limits).step(y_ref),
        float(Compensator(model, **limits).run([y_ref])[0]),
        *(SelfLearningCompensator(s, mode=mode, **limits).step(y_ref, np.nan) for mode in MODES),
        *(float(SelfLearningCompensator(s, mode=mode, **limits).replay([y_ref], [np.nan])[0]) for mode in MODES),
        float(CompensatorBank(s, 1, **limits).step([y_ref], [np.nan])[0]),
    ]


@pytest.mark.parametrize(("start", "at"), [({}, 0.0), ({"x_start": 40.0}, 40.0), ({"x_limits": (3.0, 90.0)}, 3.0)])
def test_the_first_drive_is_a_step_of_the_rate_limit_away_from_where_the_stage_is(
    start: dict[str, float], at: float
) -> None:
    np.testing.assert_allclose(first_drives(9.0, **start), at + 0.1, rtol=0, atol=1e-12)
    np.testing.assert_allclose(first_drives(np.nan, **start), at, rtol=0, atol=1e-12)


def test_without_limits_given_the_drive_stays_within_the_range_of_the_model() -> None:
    assert Compensator(LINE).run([-50.0, 50.0]).tolist() == list(RANGED.x_range)


@pytest.mark.parametrize("x_start", [-20.0, 115.012345])
def test_a_stage_may_rest_at_either_end_of_a_range_that_centre_and_scale_round(
    x_start: float,
) -> None:
    wider = replace(LINE, structure=replace(RANGED, x_centre=47.5061725, x_scale=67.50617249999999))
    assert first_drives(np.nan, wider, x_start=x_start) == pytest.approx([x_start] * 7, rel=1e-12)


@settings(max_examples=60)
@given(cases(), st.lists(st.floats(), min_size=1, max_size=60))
def test_any_reference_gives_a_drive_that_is_finite_and_inside_all_limits(case: Case, y_ref: list[float]) -> None:
    s = case.structure
    (low, high), rate = (s.x_centre - 0.7 * s.x_scale, s.x_centre + 0.6 * s.x_scale), 0.03 * s.x_scale / s.sample_time
    case.state.play[:] = np.clip(case.state.play, -0.7, 0.6)  # the actuator stands inside its limits
    compensator = Compensator(case.model, (low, high), rate, case.state)
    start = s.x_centre + s.x_scale * compensator.state.play[0]
    x = compensator.run(np.array(y_ref))
    assert np.all((x >= low) & (x <= high))
    rounding = 4 * np.spacing(abs(s.x_centre) + s.x_scale)
    assert np.all(np.abs(np.diff(x, prepend=start)) <= rate * s.sample_time + rounding)
    assert all(np.all(np.isfinite(z)) for z in (compensator.state.play, compensator.state.creep))


@settings(max_examples=30)
@given(cases())
def test_without_limits_the_drive_stays_finite_too(case: Case) -> None:
    assert np.all(np.isfinite(Compensator(case.model, FREE).run([1e300, -1.7e308, np.inf, np.nan, 0.0])))


@settings(max_examples=30)
@given(cases())
def test_after_a_spoiled_reference_the_model_is_met_again_at_once(case: Case) -> None:
    s = case.structure
    good = case.model.simulate(s.x_centre + 0.5 * s.x_scale * drive(case.rng, 60), case.state)
    y_ref = np.concatenate([spoiled(good, float(good.min()), float(good.max()) + 1e-9, 1, 20), good])
    x = Compensator(case.model, (s.x_centre - 3 * s.x_scale, s.x_centre + 3 * s.x_scale), state=case.state).run(y_ref)
    y = case.model.simulate(x, case.state)
    free = (np.abs(x - s.x_centre) < 2.999 * s.x_scale) & (np.arange(x.size) >= 60)
    np.testing.assert_allclose(
        y[free], y_ref[free], rtol=0, atol=1e-10 * s.y_scale + 8 * np.spacing(abs(s.y_centre) + s.y_scale)
    )


SMALL = ModelStructure.equidistant(n=1, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(), sample_time=1e-3)


def test_a_change_of_model_leaves_no_bump_and_fades_into_the_new_one() -> None:
    old, new = (HysteresisCreepModel.from_weights(SMALL, w) for w in ([0.5, 1.5], [0.2, 1.0]))
    y_ref, drives = np.concatenate([np.sin(np.arange(50) / 10), np.full(200, 0.3)]), []
    for model, blend_time_s in ((old, 0.0), (new, 0.0), (new, 5e-3)):
        compensator = Compensator(old, (-1.0, 1.0))
        compensator.run(y_ref[:60])
        compensator.change_model(model, blend_time_s=blend_time_s)
        drives.append(compensator.run(y_ref[60:]))
    before, after, x = drives
    assert abs(before[0] - after[0]) > 0.05
    assert x[0] == pytest.approx(before[0], abs=1e-12)
    assert abs(x[5] - after[5]) == pytest.approx(abs(x[0] - after[0]) / np.e, rel=0.2)
    assert abs(compensator.drive[BUMP]) < 1e-15
    assert compensator.model is new


def test_an_unreachable_reference_leaves_no_bump_behind_when_the_model_changes() -> None:
    steep, flat = (HysteresisCreepModel.from_weights(SMALL, [0.0, slope]) for slope in (2.0, 1.0))
    compensator = Compensator(steep, (-1.0, 1.0))
    compensator.run([1e300])
    compensator.change_model(flat, blend_time_s=1.0)
    assert compensator.step(0.25) == pytest.approx(0.25)


@settings(max_examples=40)
@given(cases(), st.integers(0, 60), st.booleans())
def test_memory_and_restore_go_on_bit_for_bit_and_single_steps_do_so_to_rounding(
    case: Case, cut: int, rings: bool
) -> None:
    s, y_ref = case.structure, case.reference(60)
    dynamics = Dynamics((0.1 / s.sample_time,), (0.03,), (0.8,), 0.5 * s.sample_time) if rings else None
    line, model = (
        replace(each, dynamics=dynamics) for each in (HysteresisCreepModel.from_weights(s, s.straight_line), case.model)
    )
    limits = s.x_range if rings else FREE
    whole, one, by_sample = (Compensator(line, limits, state=case.state) for _ in range(3))
    for each in (whole, one, by_sample):
        each.change_model(model, 20.0 * s.sample_time)
    first = one.run(y_ref[:cut])
    other = Compensator(line, limits)
    other.restore(one.get_state())
    x = whole.run(y_ref)
    np.testing.assert_array_equal(np.concatenate([first, other.run(y_ref[cut:])]), x)
    np.testing.assert_allclose([by_sample.step(y) for y in y_ref], x, rtol=0, atol=case.x_tolerance)


GAIN = 0.3
STRUCTURE = structure_for(sensor())
MODEL = HysteresisCreepModel.from_weights(
    STRUCTURE, np.concatenate([STRUCTURE.straight_line[:1], STRUCTURE.straight_line[1:] + 0.02])
)
LIMITS = (0.0, 150.0)


def closed(
    y_ref: np.ndarray, added: np.ndarray, gain: float, reversed_output: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Drives and errors (N,) of the closed loop with an actuator that the model describes exactly and a disturbance
    ``added`` to its output."""
    model = replace(MODEL, structure=STRUCTURE.reversed_output()) if reversed_output else MODEL
    compensator = Compensator(model, LIMITS, integral_gain=gain / T)
    state, x, error = compensator.state.copy(), np.empty(y_ref.size), np.empty(y_ref.size)
    for k in range(y_ref.size):
        x[k] = compensator.step(y_ref[k])
        (y,), state = model.advance(x[k : k + 1], state)
        y += added[k]
        compensator.correct(y)
        error[k] = y_ref[k] - y
    return x, error


@pytest.mark.parametrize("reversed_output", [False, True])
def test_a_step_of_a_disturbance_decays_by_the_gain_each_sample_whatever_the_hysteresis(reversed_output: bool) -> None:
    y_ref = 6.0 * np.sin(np.arange(80) / 9.0)
    error = closed(y_ref, np.where(np.arange(80) >= 40, 0.5, 0.0), GAIN, reversed_output)[1]
    np.testing.assert_allclose(error, np.r_[np.zeros(40), -0.5 * (1.0 - GAIN) ** np.arange(40)], atol=1e-11)


def test_the_fastest_disturbance_is_amplified_by_no_more_than_the_stated_peak() -> None:
    error = closed(np.zeros(200), 0.1 * (-1.0) ** np.arange(200), GAIN)[1]
    assert np.abs(error[100:]).max() == pytest.approx(0.1 * 2.0 / (2.0 - GAIN), rel=1e-6)


def test_the_integral_stops_while_the_limits_hold_the_drive() -> None:
    y_ref = np.concatenate([np.full(300, 60.0), np.full(20, 1.0), np.full(300, -60.0), np.full(20, 1.0)])
    x, error = closed(y_ref, np.zeros(y_ref.size), GAIN)
    assert (x.min(), x.max()) == LIMITS
    np.testing.assert_allclose(np.r_[error[300:320], error[620:]], 0.0, atol=1e-10)


def test_the_integral_ignores_samples_without_a_reference_or_an_output() -> None:
    compensator = Compensator(MODEL, LIMITS, integral_gain=GAIN / T)
    compensator.correct(5.0)  # before the first drive
    for y_ref, y in ((1.0, np.nan), (np.nan, 5.0), (np.inf, 5.0)):
        compensator.step(y_ref)
        compensator.correct(y)
    assert compensator.drive[CORRECTION] == 0.0


def test_a_change_of_model_leaves_no_bump_in_the_drive() -> None:
    compensator = Compensator(MODEL, LIMITS, integral_gain=GAIN / T)
    before = [compensator.step(2.0) for _ in range(50) if compensator.correct(1.8) is None][-1]
    compensator.change_model(HysteresisCreepModel.from_weights(STRUCTURE, STRUCTURE.straight_line), blend_time_s=1.0)
    assert compensator.step(2.0) == pytest.approx(before, abs=0.2)


@pytest.mark.parametrize("mode", MODES)
def test_a_learner_suppresses_an_unmodelled_disturbance_and_replays_to_the_last_bit(mode: str) -> None:
    y_ref = steps(sensor(), 20.0)
    added = 0.3 * np.sin(np.arange(y_ref.size) * 2.0 * np.pi * T)
    errors = []
    for gain in (0.0, GAIN / T):
        plant, learner, rest = sensor(), learner_for(sensor(), mode, integral_gain=gain), iter(added)
        x, y = learner.run(y_ref, lambda x, plant=plant, rest=rest: np.add(plant.run(x), [*islice(rest, x.size)]))
        errors.append(float(np.sqrt(np.mean((y - y_ref)[-5000:] ** 2))))
    assert errors[1] < 0.2 * errors[0]
    replayed = learner_for(sensor(), mode, integral_gain=GAIN / T).replay(y_ref, np.append(np.nan, y[:-1]))
    np.testing.assert_array_equal(replayed, x)
