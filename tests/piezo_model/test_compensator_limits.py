"""Whatever the reference is, the drive is finite and inside its limits."""

import math

import numpy as np
import pytest
from faulty_sensor import spoiled
from hypothesis import given, settings
from hypothesis import strategies as st
from random_models import FREE, Case, cases, drive

from piezo_model.compensator import BUMP, Compensator
from piezo_model.model import HysteresisCreepModel
from piezo_model.structure import ModelStructure

ANY = st.floats(allow_nan=True, allow_infinity=True)


def limited(case: Case) -> tuple[Compensator, tuple[float, float], float]:
    s = case.structure
    limits = s.x_centre - 0.7 * s.x_scale, s.x_centre + 0.6 * s.x_scale
    case.state.play[:] = np.clip(case.state.play, -0.7, 0.6)  # the actuator stands inside its limits
    rate = 0.03 * s.x_scale / s.sample_time
    return Compensator(case.model, limits, rate, case.state), limits, rate * s.sample_time


@settings(max_examples=60)
@given(cases(), st.lists(ANY, min_size=1, max_size=60))
def test_any_reference_gives_a_drive_that_is_finite_and_inside_all_limits(case: Case, y_ref: list[float]) -> None:
    compensator, (low, high), step = limited(case)
    start = case.structure.x_centre + case.structure.x_scale * compensator.state.play[0]
    x = compensator.run(np.array(y_ref))
    assert np.all(np.isfinite(x))
    assert np.all((x >= low) & (x <= high))
    rounding = 4 * np.spacing(abs(case.structure.x_centre) + case.structure.x_scale)
    assert np.all(np.abs(np.diff(x, prepend=start)) <= step + rounding)
    assert all(np.all(np.isfinite(z)) for z in (compensator.state.play, compensator.state.creep))


@settings(max_examples=30)
@given(cases())
def test_without_limits_the_drive_stays_finite_too(case: Case) -> None:
    x = Compensator(case.model, FREE).run([1e300, -1.7e308, math.inf, math.nan, 0.0])
    assert np.all(np.isfinite(x))


@settings(max_examples=30)
@given(cases())
def test_after_a_spoiled_reference_the_model_is_met_again_at_once(case: Case) -> None:
    s = case.structure
    good = case.model.simulate(s.x_centre + 0.5 * s.x_scale * drive(case.rng, 60), case.state)
    y_ref = np.concatenate([spoiled(good, float(good.min()), float(good.max()) + 1e-9, 1, 20), good])
    compensator = Compensator(case.model, (s.x_centre - 3 * s.x_scale, s.x_centre + 3 * s.x_scale), state=case.state)
    x = compensator.run(y_ref)
    y = case.model.simulate(x, case.state)
    free = (np.abs(x - s.x_centre) < 2.999 * s.x_scale) & (np.arange(x.size) >= 60)
    np.testing.assert_allclose(
        y[free], y_ref[free], rtol=0, atol=1e-10 * s.y_scale + 8 * np.spacing(abs(s.y_centre) + s.y_scale)
    )


SMALL = ModelStructure.equidistant(n=1, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(), sample_time=1e-3)


def test_a_change_of_model_leaves_no_bump_and_fades_into_the_new_one() -> None:
    old, new = (HysteresisCreepModel.from_weights(SMALL, w) for w in ([0.5, 1.5], [0.2, 1.0]))
    y_ref = np.concatenate([np.sin(np.arange(50) / 10), np.full(200, 0.3)])
    changed, unchanged, jumped = (Compensator(old, (-1.0, 1.0)) for _ in range(3))
    for c in (changed, unchanged, jumped):
        c.run(y_ref[:60])
    changed.change_model(new, blend_time_s=5e-3)
    jumped.change_model(new)
    x, before, after = changed.run(y_ref[60:]), unchanged.run(y_ref[60:]), jumped.run(y_ref[60:])
    assert abs(before[0] - after[0]) > 0.05
    assert x[0] == pytest.approx(before[0], abs=1e-12)
    assert abs(x[5] - after[5]) == pytest.approx(abs(x[0] - after[0]) / math.e, rel=0.2)
    assert abs(changed.drive[BUMP]) < 1e-15
    assert changed.model is new


def test_an_unreachable_reference_leaves_no_bump_behind_when_the_model_changes() -> None:
    steep, flat = (HysteresisCreepModel.from_weights(SMALL, [0.0, slope]) for slope in (2.0, 1.0))
    compensator = Compensator(steep, (-1.0, 1.0))
    compensator.run([1e300])
    compensator.change_model(flat, blend_time_s=1.0)
    assert compensator.step(0.25) == pytest.approx(0.25)


@settings(max_examples=20)
@given(cases(), st.integers(0, 60))
def test_memory_and_restore_go_on_bit_for_bit(case: Case, cut: int) -> None:
    s = case.structure
    y_ref = s.y_centre + s.y_scale * drive(case.rng, 60)
    whole, one = (
        Compensator(case.model, (s.x_centre - s.x_scale, s.x_centre + s.x_scale), state=case.state) for _ in range(2)
    )
    first = one.run(y_ref[:cut])
    other = Compensator(
        HysteresisCreepModel.from_weights(s, s.straight_line), (s.x_centre - s.x_scale, s.x_centre + s.x_scale)
    )
    other.restore(one.get_state())
    np.testing.assert_array_equal(np.concatenate([first, other.run(y_ref[cut:])]), whole.run(y_ref))
