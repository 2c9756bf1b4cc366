"""What a learner finds out about its actuator: an output that falls as the input rises, which a structure that rises
does not learn and one that falls does, and the ranges that are driven, which its thresholds follow."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from learning_loops import MODES, WAYS, T, Vector, error_of, learner_for, sensor, steps, stretched, structure_for
from random_models import drive

from piezo_model import (
    Compensator,
    HysteresisCreepModel,
    ModelStructure,
    OperatorState,
    SelfLearningCompensator,
    plants,
)
from piezo_model.learning.driven_range import LONGEST, UNDER, DrivenRange, carried_over
from piezo_model.learning.events import REVERSED

NAMES = plants.names()
SECONDS = 8
TIME = np.arange(SECONDS * 1000) * T


def structure_of(name: str, negative_gain: bool = False) -> ModelStructure:
    rising = structure_for(plants.get(name, sample_time=T))
    return rising.reversed_output() if negative_gain else rising


def measured(name: str, gain: float, noise: float = 1e-3, lag: int = 0, drift: float = 0.0) -> Callable[..., Vector]:
    """Output of an actuator as a sensor shows it; noise and drift per second as shares of the range, lag in samples."""
    plant, random, true = plants.get(name, sample_time=T), np.random.default_rng(1), list[float]()
    low, high = plant.y_range

    def act(x: Vector) -> Vector:
        true.extend(plant.run(x))
        k = np.arange(len(true) - x.size, len(true))
        first = max(int(k[0]) - lag, 0)
        y = np.array(true[first:])[np.maximum(k - lag, 0) - first] + (high - low) * drift * T * k
        return 0.5 * (low + high) + gain * (y - 0.5 * (low + high)) + noise * (high - low) * random.normal(size=x.size)

    return act


def wanted(name: str, shape: Vector) -> Vector:
    """A reference from a shape between -1 and 1, over three quarters of the range."""
    low, high = plants.get(name, sample_time=T).y_range
    return 0.5 * (low + high) + 0.375 * (high - low) * shape


def learner_of(structure: ModelStructure, mode: str, solver: str = "box_active_set", **options: Any) -> Any:
    return SelfLearningCompensator(
        structure,
        solver=solver,
        mode=mode,  # type: ignore[arg-type]
        **{"reset_s": 0.1, "build_s": 2.0, "learn_s": 0.5, "hand_over_s": 0.02, "solve_delay_samples": 5, **options},
    )


def said(learner: SelfLearningCompensator) -> list[str]:
    """Kinds of the log entries about the direction."""
    return [event.what for event in learner.log if event.message == REVERSED]


SINE = np.sin(2 * np.pi * TIME)
SINES = 0.5 * SINE + 0.3 * np.sin(2 * np.pi * 1.9 * TIME + 1.0) + 0.2 * np.sin(2 * np.pi * 3.7 * TIME + 2.0)
RIGHT: dict[str, tuple[Vector, dict[str, float]]] = {
    **{f"at rest, noise of {noise}": (0.0 * SINE, {"noise": noise}) for noise in (0.0, 1e-3, 0.02)},
    **{f"no sensor, noise of {noise}": (SINE, {"gain": 0.0, "noise": noise}) for noise in (0.0, 1e-3, 0.02)},
    "noise of one per cent": (SINE, {"noise": 0.01}),
    "noise of five per cent": (SINE, {"noise": 0.05}),
    "small excursions": (0.07 * SINE, {}),
    "a lag of a quarter of the fastest period": (SINES, {"lag": 68}),
    "a drift of half the range": (SINE, {"drift": 0.5 / SECONDS}),
    "a slow reference": (np.sin(2 * np.pi * 0.2 * TIME), {}),
    "a fast reference": (np.sin(2 * np.pi * 100.0 * TIME), {}),
    "levels": (np.round(3.0 * SINE) / 3.0, {}),
}


@pytest.mark.sample(6)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("mode", "solver"), WAYS)
def test_while_the_output_falls_the_straight_line_drives_and_the_log_says_so_once(
    name: str, mode: str, solver: str
) -> None:
    structure, y_ref = structure_of(name), wanted(name, SINE)
    learner = learner_of(structure, mode, solver)
    x, _ = learner.run(y_ref, measured(name, gain=-1.0))
    assert (said(learner), learner.counts["hand_overs"]) == (["refused"], 0)
    assert 0 < learner.counts["reversed"] <= learner.counts["refusals"]
    np.testing.assert_array_equal([learner.model.weights, learner.learned_weights], [structure.straight_line] * 2)
    np.testing.assert_array_equal(x, Compensator(learner.model).run(y_ref))
    assert structure.x_range[0] < x.min() < x.max() < structure.x_range[1]


@pytest.mark.sample(6)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("mode", "solver"), WAYS)
def test_a_descending_range_learns_a_falling_output_as_an_ascending_one_a_rising_output(
    name: str, mode: str, solver: str
) -> None:
    errors = []
    for gain in (1.0, -1.0):
        learner, reference = learner_of(structure_of(name, gain < 0.0), mode, solver), wanted(name, gain * SINE)
        _, y = learner.run(reference, measured(name, gain, noise=0.0))
        assert learner.counts["hand_overs"] > 0
        assert (learner.counts["reversed"], said(learner)) == (0, [])
        errors.append((y - reference)[-1000:])
    low, high = plants.get(name).y_range
    np.testing.assert_allclose(errors[1], -errors[0], atol=1e-6 * (high - low))


@pytest.mark.sample(28)
@pytest.mark.parametrize("case", RIGHT)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", NAMES)
def test_a_rising_output_is_not_taken_for_a_falling_one(mode: str, name: str, case: str) -> None:
    shape, sensor = RIGHT[case]
    learner = learner_of(structure_of(name), mode)
    learner.run(wanted(name, shape), measured(name, **{"gain": 1.0, **sensor}))
    assert (learner.counts["reversed"], said(learner)) == (0, [])
    # the sensor guard takes noise of five per cent for jumps again and again
    assert learner.counts["hand_overs"] > 0 or case.startswith(("at rest", "no sensor", "noise of five"))


@pytest.mark.parametrize("mode", MODES)
def test_learning_goes_on_when_the_sensor_is_put_right_also_after_a_file(mode: str, tmp_path: Path) -> None:
    name, y_ref = NAMES[-1], wanted(NAMES[-1], SINE)
    learner = learner_of(structure_of(name), mode)
    learner.run(y_ref, measured(name, gain=-1.0))
    learner.save(tmp_path / "learner.json")
    resumed = SelfLearningCompensator.load(tmp_path / "learner.json")
    for each in (learner, resumed):
        for _ in range(2):
            each.run(y_ref, measured(name, gain=1.0))
        assert (each.counts["hand_overs"] > 0, said(each)) == (True, ["refused"])
    np.testing.assert_array_equal(learner.model.weights, resumed.model.weights)


WIDE = ModelStructure.equidistant(3, 0, (0.0, 10.0), (-2.0, 5.0), (10.0, 1.0), 1e-3, offset=True)


@settings(max_examples=30)
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(0.5, 2.0), st.integers(0, 99))
def test_a_model_straight_between_the_new_thresholds_is_unchanged_in_other_ranges(
    h: float, k: float, y: float, seed: int
) -> None:
    # thresholds at ⅛, ¼, ⅜ of the old
    new = replace(WIDE, x_centre=5.0 + 5.0 * h, x_scale=2.5, y_centre=1.5 + 3.5 * k, y_scale=3.5 * y)
    model = HysteresisCreepModel.from_weights(WIDE, [0.3, 0.0, 0.0, 1.3, 0.02, 0.01, 0.0, 0.0, 0.1])
    carried = carried_over(model, new)
    x = 5.0 + 5.0 * h + 1.2 * drive(np.random.default_rng(seed), 400)
    begin = OperatorState.settled_at(WIDE, WIDE.x_centre + h * WIDE.x_scale)
    np.testing.assert_allclose(carried.simulate(x, begin.rescaled_to(WIDE, new)), model.simulate(x, begin), atol=1e-12)
    Compensator(carried).restore(Compensator(carried).get_state())


def test_a_range_grows_at_once_and_shrinks_with_patience_and_an_axis_at_a_time() -> None:
    s, driven = WIDE, DrivenRange()
    grown = driven.observe((-1.5, 0.9, -1.0, 1.0), s)
    assert grown.x_range[0] < 5.0 - 1.5 * 5.0 < 10.0 < grown.x_range[1]
    assert (grown.y_centre, grown.y_scale) == (s.y_centre, s.y_scale)
    *before, shrunk = [driven.observe((0.1, 0.5, -0.9, 0.9), s) for _ in range(min(UNDER))]
    assert before == [None] * (min(UNDER) - 1)
    assert (shrunk.x_centre, shrunk.x_scale, shrunk.y_scale) == (pytest.approx(6.5), pytest.approx(1.1), s.y_scale)
    # if only a quarter of the range is unused, the whole memory is required
    driven = DrivenRange()
    *before, patient = [driven.observe((-0.7, 0.7, -0.9, 0.9), s) for _ in range(LONGEST)]
    assert before == [None] * (LONGEST - 1)
    assert patient.x_scale == pytest.approx(5.0 * 0.7 * 1.1)


def test_an_output_beyond_its_range_counts_in_a_piece_without_a_fault_only() -> None:
    driven = DrivenRange(per_piece=2)
    assert [driven.observe((-1.0, 1.0, -3.0, 1.0), WIDE), driven.interrupt()] == [None, None]
    *before, grown = [driven.observe((-1.0, 1.0, y, 1.0), WIDE) for y in (-1.0, -1.0, -1.0, -1.0, -3.0, -1.0)]
    assert (before, grown is None) == ([None] * 5, False)


@pytest.mark.sample(2)
@pytest.mark.parametrize("mode", ["cyclic", "continuous"])
@pytest.mark.parametrize("guess", [0.5, 3.0])
def test_ranges_given_half_or_three_times_as_wide_are_mended(mode: str, guess: float) -> None:
    errors = []
    for factor in (1.0, guess):
        one, s = sensor(), stretched(factor)
        state = OperatorState.settled_at(s, one.x_range[0], came_from="above")
        learner = learner_of(s, mode, x_limits=one.x_range, build_s=4.0, state=state)
        errors.append(error_of(learner, steps(one, 90.0), one.run, one, slice(-8000, None)))
        assert learner.structure.x_scale == pytest.approx(stretched(1.0).x_scale, rel=0.2)
    assert errors[1] < 1.5 * errors[0]


def test_a_model_that_is_given_keeps_its_thresholds() -> None:
    one, wide = sensor(), stretched(3.0)
    model = HysteresisCreepModel.from_weights(wide, wide.straight_line)
    learner = learner_of(wide, "cyclic", x_limits=one.x_range, build_s=1.0, learn_s=0.1, model=model)
    learner.run(steps(one, 8.0), one.run)
    assert learner.structure == wide
    assert learner_for(one).settings.adapt_range
