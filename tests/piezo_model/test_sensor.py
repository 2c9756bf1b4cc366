"""The sensor of a plant: the size of each of its errors, and their repeatability; a learner's verdict on each of its
samples."""

from itertools import pairwise

import numpy as np
import pytest
from driven_plants import TS, bare, walk
from hypothesis import given
from hypothesis import strategies as st

from piezo_model import ModelStructure, SelfLearningCompensator, plants
from piezo_model.learning.events import Verdict


def resting():
    """A plant without creep, whose range is not symmetric."""
    return plants.get("bouc_wen", sample_time=TS, creep_share=0.0, y_range=(10.0, 50.0))


def added(size=50_000, **options):
    """Error of the sensor of a plant at rest."""
    still = np.zeros(size)
    return plants.Sensor(resting(), **options).run(still) - resting().run(still)


def test_the_noise_has_its_standard_deviation_and_is_white():
    m = added(noise_um=0.02, seed=1)
    assert m.mean() == pytest.approx(0.0, abs=5e-4)
    assert m.std() == pytest.approx(0.02, rel=0.02)
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


FROZEN_DRIVE, JUMP, PLAUSIBLE = 0.02, 0.25, 4.0

RAMP = np.linspace(-0.5, 0.5, 200)


def judged(x: np.ndarray, y: np.ndarray) -> list[Verdict]:
    """Verdicts of a new compensator on drives and outputs in normalised units."""
    learner = SelfLearningCompensator(
        ModelStructure.equidistant(1, 0, (-1.0, 1.0), (-1.0, 1.0), (), 1e-3), adapt_range=False
    )
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


def gap(value: float, y: np.ndarray = RAMP, begin: int = 50, end: int = 60) -> np.ndarray:
    """The signal with a part replaced by one value."""
    k = np.arange(y.size)
    return np.where((k >= begin) & (k < end), value, y)


@pytest.mark.parametrize(
    ("x", "y", "bad"),
    [
        *((RAMP, gap(value), dict.fromkeys(range(50, 60), Verdict.MISSING)) for value in (np.nan, np.inf, -np.inf)),
        (RAMP, gap(PLAUSIBLE * 1.01, begin=10, end=11), {10: Verdict.REFUSED}),
        (RAMP, gap(-1e9, begin=20, end=21), {20: Verdict.REFUSED}),
        (RAMP, RAMP + 1.5 * JUMP * (K >= 100), {100: Verdict.JUMPED}),
        (RAMP, gap(RAMP[49], end=150), dict.fromkeys(range(53, 150), Verdict.REFUSED)),
        (STEPS, STEPS, {}),
        (0.3 + 0.4 * FROZEN_DRIVE * np.sign(np.sin(np.arange(5000))), np.full(5000, 0.2), {}),
        (4.0 * RAMP, gap(np.nan, 4.0 * RAMP, 50, 150), dict.fromkeys(range(50, 150), Verdict.MISSING)),
    ],
    ids=[
        "NaN",
        "infinite",
        "minus infinity",
        "far above",
        "far below",
        "a jump is one sample",
        "frozen from the sample on at which the drive has moved until it changes",
        "a fast drive explains a fast output",
        "a drive that trembles freezes nothing",
        "the way of the drive in a gap explains that of the output",
    ],
)
def test_every_kind_of_bad_sample_is_rejected_and_no_good_one(
    x: np.ndarray, y: np.ndarray, bad: dict[int, Verdict]
) -> None:
    assert {k: v for k, v in enumerate(judged(x, y)) if v is not Verdict.GOOD} == bad
