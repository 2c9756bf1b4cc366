import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezo_model.learning.sensor_guard import SensorGuard, Verdict

FROZEN_DRIVE, JUMP, PLAUSIBLE = 0.02, 0.25, 4.0

RAMP = np.linspace(-0.5, 0.5, 200)


def judged(x: np.ndarray, y: np.ndarray) -> list[Verdict]:
    return [Verdict(v) for v in SensorGuard().judge(x, y)]


@given(st.integers(0, 2**32 - 1))
def test_a_sensor_that_follows_its_actuator_is_good_at_every_sample(seed: int) -> None:
    random = np.random.default_rng(seed)
    x = np.cumsum(random.normal(0.0, 0.02, 300)).clip(-1.0, 1.0)
    assert set(judged(x, 0.9 * x + random.normal(0.0, 1e-3, x.size))) == {Verdict.GOOD}


@given(
    st.lists(st.floats(-1e300, 1e300) | st.sampled_from([math.nan, math.inf, -math.inf]), max_size=40),
    st.integers(0, 40),
)
def test_chunks_are_judged_as_the_whole_is(y: list[float], cut: int) -> None:
    x, y_array, guard = np.linspace(-1.0, 1.0, len(y)), np.array(y), SensorGuard()
    parts = [guard.judge(x[:cut], y_array[:cut]), guard.judge(x[cut:], y_array[cut:])]
    np.testing.assert_array_equal(np.concatenate(parts), SensorGuard().judge(x, y_array))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_no_finite_number_is_missing_and_nothing_else_follows(bad: float) -> None:
    y = RAMP.copy()
    y[50:60] = bad
    verdicts = judged(RAMP, y)
    assert set(verdicts[50:60]) == {Verdict.MISSING}
    assert set(verdicts[:50] + verdicts[60:]) == {Verdict.GOOD}


def test_what_lies_far_outside_the_range_is_refused() -> None:
    y = RAMP.copy()
    y[10], y[20] = PLAUSIBLE * 1.01, -1e9
    assert [k for k, v in enumerate(judged(RAMP, y)) if v is Verdict.REFUSED] == [10, 20]


def test_a_frozen_sensor_is_refused_as_soon_as_the_drive_has_moved_and_good_again_when_it_changes() -> None:
    y = RAMP.copy()
    y[50:150] = y[49]
    verdicts = judged(RAMP, y)
    moved = int(FROZEN_DRIVE / (RAMP[1] - RAMP[0])) + 2
    assert set(verdicts[50 + moved : 150]) == {Verdict.REFUSED}
    assert set(verdicts[:50] + verdicts[150:]) == {Verdict.GOOD}


def test_a_sensor_is_not_frozen_while_the_drive_stands_still_or_trembles() -> None:
    x = 0.3 + 0.4 * FROZEN_DRIVE * np.sign(np.sin(np.arange(5000)))
    assert set(judged(x, np.full(5000, 0.2))) == {Verdict.GOOD}


def test_a_jump_is_one_sample_and_a_fast_drive_explains_a_fast_output() -> None:
    y = RAMP.copy()
    y[100:] += 1.5 * JUMP
    assert [k for k, v in enumerate(judged(RAMP, y)) if v is Verdict.JUMPED] == [100]
    steps = np.repeat([-1.0, 1.0, -1.0], 10)
    assert set(judged(steps, steps)) == {Verdict.GOOD}


def test_the_way_of_the_drive_during_a_gap_explains_what_the_output_did_in_it() -> None:
    x = np.linspace(-1.0, 1.0, 400)
    y = x.copy()
    y[100:300] = np.nan
    assert Verdict.JUMPED not in judged(x, y)
