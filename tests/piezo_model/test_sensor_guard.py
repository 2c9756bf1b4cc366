import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezo_model import ModelStructure, SelfLearningCompensator
from piezo_model.learning.events import Verdict

UNIT = ModelStructure.equidistant(1, 0, (-1.0, 1.0), (-1.0, 1.0), (), 1e-3)
FROZEN_DRIVE, JUMP, PLAUSIBLE = 0.02, 0.25, 4.0

RAMP = np.linspace(-0.5, 0.5, 200)


def judged(x: np.ndarray, y: np.ndarray) -> list[Verdict]:
    """Verdicts of a new compensator on drives and outputs in normalised units."""
    learner = SelfLearningCompensator(UNIT, adapt_range=False)
    counts = [learner.counts]
    for sample in zip(x[:, None], y[:, None], strict=True):
        learner.observe(*sample)
        counts.append(learner.counts)
    return [next(v for v in Verdict if now[v.name.lower()] > old[v.name.lower()]) for old, now in pairwise(counts)]


@given(st.integers(0, 2**32 - 1))
def test_a_sensor_that_follows_its_actuator_is_good_at_every_sample(seed: int) -> None:
    random = np.random.default_rng(seed)
    x = np.cumsum(random.normal(0.0, 0.02, 300)).clip(-1.0, 1.0)
    assert set(judged(x, 0.9 * x + random.normal(0.0, 1e-3, x.size))) == {Verdict.GOOD}


K, STEPS = np.arange(200), np.repeat([-1.0, 1.0, -1.0], 10)
TREMBLING = 0.3 + 0.4 * FROZEN_DRIVE * np.sign(np.sin(np.arange(5000)))


def gap(value: float, y: np.ndarray = RAMP, begin: int = 50, end: int = 60) -> np.ndarray:
    """The signal with a part replaced by one value."""
    k = np.arange(y.size)
    return np.where((k >= begin) & (k < end), value, y)


@pytest.mark.parametrize(
    ("x", "y", "bad"),
    [
        *(
            (RAMP, gap(value), dict.fromkeys(range(50, 60), Verdict.MISSING))
            for value in (math.nan, math.inf, -math.inf)
        ),
        (RAMP, gap(PLAUSIBLE * 1.01, begin=10, end=11), {10: Verdict.REFUSED}),
        (RAMP, gap(-1e9, begin=20, end=21), {20: Verdict.REFUSED}),
        (RAMP, RAMP + 1.5 * JUMP * (K >= 100), {100: Verdict.JUMPED}),
        (STEPS, STEPS, {}),
        (TREMBLING, np.full(5000, 0.2), {}),
        (4.0 * RAMP, gap(math.nan, 4.0 * RAMP, 50, 150), dict.fromkeys(range(50, 150), Verdict.MISSING)),
    ],
    ids=[
        "NaN",
        "infinite",
        "minus infinity",
        "far above",
        "far below",
        "a jump is one sample",
        "a fast drive explains a fast output",
        "a drive that trembles freezes nothing",
        "the way of the drive in a gap explains that of the output",
    ],
)
def test_every_kind_of_bad_sample_is_rejected_and_no_good_one(
    x: np.ndarray, y: np.ndarray, bad: dict[int, Verdict]
) -> None:
    assert {k: v for k, v in enumerate(judged(x, y)) if v is not Verdict.GOOD} == bad


def test_a_frozen_sensor_is_refused_as_soon_as_the_drive_has_moved_and_good_again_when_it_changes() -> None:
    y = RAMP.copy()
    y[50:150] = y[49]
    verdicts = judged(RAMP, y)
    moved = int(FROZEN_DRIVE / (RAMP[1] - RAMP[0])) + 2
    assert set(verdicts[50 + moved : 150]) == {Verdict.REFUSED}
    assert set(verdicts[:50] + verdicts[150:]) == {Verdict.GOOD}
