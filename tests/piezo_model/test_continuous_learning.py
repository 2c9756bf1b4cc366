"""Continuous operation: drift, rest, and faults, over which the learned weights are kept; the verdict on each sample of
a sensor."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from learning_loops import MODES, T, at_work, error_of, learner_for, rms_percent, sensor, steps

from piezo_model import HysteresisCreepModel, ModelStructure, OperatorState, SelfLearningCompensator, plants
from piezo_model.learning.events import Phase, Verdict
from piezo_model.signals import multi_sine


def learned(share: float = 1.0) -> tuple[plants.Sensor, SelfLearningCompensator, np.ndarray, float]:
    """A plant, its learner after one reference, the reference, and the remaining error."""
    plant, learner, y_ref = at_work(20.0, "continuous")
    return plant, learner, share * y_ref, error_of(learner, share * y_ref, plant.run, plant, slice(-5000, None))


def test_it_follows_a_drift_of_the_gain_better_than_cycles_and_within_twice_the_error_without() -> None:
    errors = {}
    for mode, drift in (("continuous", 0.05 / 60.0), ("cyclic", 0.05 / 60.0), ("continuous", 0.0)):
        plant = sensor(gain_drift_per_s=drift)
        learner, y_ref = learner_for(plant, mode, build_s=8.0), steps(plant, 60.0)
        errors[mode, drift > 0.0] = error_of(learner, y_ref, plant.run, plant, slice(10_000, None))
    assert errors["continuous", True] < errors["cyclic", True]
    assert errors["continuous", True] < 2.0 * errors["continuous", False]


@pytest.mark.slow
def test_hours_at_rest_cause_no_wind_up() -> None:
    plant, learner, y_ref, before = learned()
    rest = np.full(600_000, 5.0)
    assert error_of(learner, rest, plant.run, plant, slice(-5000, None)) < before
    kept = learner.model.weights, learner.counts["hand_overs"]
    learner.run(rest[:100_000], plant.run)
    np.testing.assert_equal((learner.model.weights, learner.counts["hand_overs"]), kept)
    y = learner.run(y_ref, plant.run)[1]
    assert rms_percent(y[500:5000], y_ref[500:5000], plant) < 3.0 * before
    assert rms_percent(y[-5000:], y_ref[-5000:], plant) < 1.1 * before


def learned_with_noise(
    noise: float, forgetting_time_s: float, negative_gain: bool = False
) -> tuple[SelfLearningCompensator, float]:
    """A learner on an actuator of its own structure with a noisy sensor, as a share of the range, and the RMS error of
    what it learned in units of the noise."""
    s = ModelStructure.equidistant(
        5, 3, (0.0, 100.0), (24.0, -2.0) if negative_gain else (-2.0, 24.0), (), T, offset=True
    )
    weights = [0.05, 0.08, 0.04, 0.06, 0.05, 0.03, -0.02, 0.04, 1.12, -0.05, 0.06, 0.03, 0.02]
    truth, start = HysteresisCreepModel.from_weights(s, weights), OperatorState.settled_at(s, 0.0)
    x = multi_sine(duration_s=20.0, highest_Hz=6.0, sample_time=T, low=0.0, high=100.0)
    y, random, state = truth.simulate(x, start.copy()), np.random.default_rng(1), start.copy()

    def measured(x: np.ndarray) -> np.ndarray:
        nonlocal state
        clean, state = truth.advance(x, state)
        return clean + noise * np.ptp(y) * random.normal(size=x.size)

    learner = SelfLearningCompensator(
        s, mode="continuous", forgetting_time_s=forgetting_time_s, state=start.copy(), adapt_range=False
    )
    learner.run(y.mean() + 0.97 * (y - y.mean()), measured)
    error = HysteresisCreepModel.from_weights(s, learner.learned_weights).simulate(x, start) - y
    return learner, float(np.sqrt(np.mean(error**2)) / (noise * np.ptp(y)))


@pytest.mark.parametrize("noise", [0.01, 0.03])
@pytest.mark.parametrize("negative_gain", [False, True])
def test_noise_of_the_sensor_biases_no_weight(noise: float, negative_gain: bool) -> None:
    learner, error = learned_with_noise(noise, 5.0, negative_gain)
    assert error < 3.0 * np.sqrt(learner.structure.d * T / (2.0 * 5.0))


@pytest.mark.parametrize("forgetting_time_s", [0.1, 0.3])
def test_a_program_has_an_optimum_where_noise_is_most_of_it(forgetting_time_s: float) -> None:
    learner, _ = learned_with_noise(0.03, forgetting_time_s)
    assert learner.counts["hand_overs"] > 0
    assert learner._memory["failures"] == 0


def test_a_hand_over_drops_no_sample_and_the_log_has_the_first_one_only() -> None:
    plant, learner, y_ref = at_work(30.0, "continuous")
    learner.run(y_ref, plant.run)
    assert learner.samples == y_ref.size == sum(learner.counts[v] for v in ("good", "missing", "refused", "jumped"))
    assert learner.counts["hand_overs"] > 500
    assert [event.what for event in learner.log] == ["hand-over"]


@pytest.mark.parametrize("seconds", [0.001, 0.05, 3.0])
def test_after_a_drop_out_the_learned_weights_are_kept(seconds: float) -> None:
    plant, learner, y_ref, before = learned()
    learner.run(y_ref[:30], plant.run)  # into a step of the staircase
    learner.run(y_ref[30 : 30 + round(seconds / plant.sample_time)], lambda x: np.full_like(plant.run(x), 17.3))
    assert learner.counts["jumped"] + learner.counts["refused"] > 0
    assert error_of(learner, y_ref, plant.run, plant, slice(1000, 6000)) < 1.5 * before
    assert learner.phase is Phase.LEARN
    assert not any("begins anew" in event.message for event in learner.log) or seconds > 1.0


def test_a_sensor_that_was_zeroed_anew_is_learned_anew_and_first_for_as_long_as_the_memory_lasts() -> None:
    plant, learner, y_ref, before = learned(share=0.7)
    learner.run(y_ref[:30], plant.run)  # into a step of the staircase
    _, y = learner.run(np.concatenate([y_ref[30:60], y_ref]), lambda x: plant.run(x) + 6.0)
    assert rms_percent(y[-5000:], y_ref[-5000:], plant) < 1.3 * before
    *_, anew, hand_over = learner.log
    assert ("learning begins anew" in anew.message, hand_over.what) == (True, "hand-over")
    assert hand_over.sample >= anew.sample + round(learner.settings.forgetting_time_s / T)


def test_a_wrong_slope_outside_the_driven_range_is_corrected() -> None:
    plant, learner, y_ref, before = learned()
    structure, candidate = learner.structure, learner._core["candidate"]
    candidate[:] = structure.inverse_slope_map @ learner.model.weights
    candidate[structure.slices[1].stop - 1] = 0.1  # the outermost slope at its lower bound
    learner._memory["revert"] = 1.0  # whatever it predicts
    learner.run(y_ref[:20], plant.run)
    assert error_of(learner, y_ref, plant.run, plant, slice(-5000, None)) < 1.1 * before


def test_another_solver_is_called_at_each_interval_and_does_as_well() -> None:
    errors = {}
    # the last one is the default, which selects the exact solver
    for solver in ("box_active_set", "daqp", "projected_difference"):
        plant, learner, y_ref = at_work(10.0, "continuous", solver, hand_over_s=0.05)
        errors[solver] = error_of(learner, 0.7 * y_ref, plant.run, plant, slice(-4000, None))
        assert learner.counts["hand_overs"] > 20
    assert errors["box_active_set"] == errors["projected_difference"] == pytest.approx(errors["daqp"], rel=0.02)


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


@pytest.mark.nightly
@pytest.mark.parametrize("mode", MODES)
def test_error_and_memory_stay_as_they_are_and_a_day_uses_little_of_any_counter(mode: str) -> None:
    s = ModelStructure.equidistant(5, 3, (0.0, 150.0), (-20.0, 20.0), (10.0, 1.0, 0.1), 125e-6)
    plant = plants.Sensor(plants.get("relay_preisach"), noise_um=0.008)
    learner = SelfLearningCompensator(
        s,
        0.1,
        8.0,
        1.9,
        "box_active_set",
        mode=mode,
        hand_over_s=0.1,
        estimate_offset=False,
        state=OperatorState.settled_at(s, s.x_range[0], came_from="above"),
    )
    t = 2.0 * np.pi * np.arange(80_000) / 80_000
    y_ref = 15.0 * np.sin(40.0 * t) * (0.7 + 0.3 * np.sin(3.0 * t))

    def stretch(periods: int) -> tuple[float, int]:
        """RMS error, and the resident pages of this process afterwards."""
        squares = [np.mean((learner.run(y_ref, plant.run)[1] - y_ref) ** 2) for _ in range(periods)]
        return float(np.sqrt(np.mean(squares))), int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])

    stretch(10)
    rms, resident = zip(*(stretch(16) for _ in range(8)), strict=True)
    assert max(rms) < 1.05 * min(rms)
    assert resident[-1] - resident[0] < 2 * 2**20 / 4096
    days = learner.samples / (24 * 3600 / s.sample_time)
    counters = {name: int(learner._memory[name]) for name in ("faults", "failures", "fault_count")}
    assert max({**counters, **learner.counts}.values()) < days * 0.01 * 2.0**52
