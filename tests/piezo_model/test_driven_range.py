"""Thresholds that follow the driven range: conversion of model and states, and loops with wrong initial ranges."""

from dataclasses import replace

import numpy as np
import pytest
from faulty_sensor import steps
from hypothesis import given, settings
from hypothesis import strategies as st
from learning_loops import error_of, learner_for, sensor, structure_for
from random_models import drive

from piezo_model import HysteresisCreepModel, OperatorState, SelfLearningCompensator
from piezo_model.learning.driven_range import LONGEST, UNDER, DrivenRange, carried_over
from piezo_model.structure import ModelStructure


def wide_enough(m: int = 0) -> ModelStructure:
    return ModelStructure.equidistant(3, m, (0.0, 10.0), (-2.0, 5.0), (10.0, 1.0), 1e-3, offset=True)


@settings(max_examples=30)
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(0.5, 2.0), st.integers(0, 99))
def test_a_model_straight_between_the_new_thresholds_is_unchanged_in_other_ranges(
    h: float, k: float, y: float, seed: int
) -> None:
    old = wide_enough()
    # thresholds at ⅛, ¼, ⅜ of the old
    new = replace(old, x_centre=5.0 + 5.0 * h, x_scale=2.5, y_centre=1.5 + 3.5 * k, y_scale=3.5 * y)
    model = HysteresisCreepModel.from_weights(old, [0.3, 0.0, 0.0, 1.3, 0.02, 0.01, 0.0, 0.0, 0.1])
    carried = carried_over(model, new)
    x = 5.0 + 5.0 * h + 1.2 * drive(np.random.default_rng(seed), 400)
    begin = OperatorState.settled_at(old, old.x_centre + h * old.x_scale)
    after = begin.rescaled_to(old, new)
    np.testing.assert_allclose(carried.simulate(x, after), model.simulate(x, begin), atol=1e-12)


def test_a_range_grows_at_once_and_shrinks_with_patience_and_an_axis_at_a_time() -> None:
    s, driven = wide_enough(), DrivenRange()
    grown = driven.observe((-1.5, 0.9, -1.0, 1.0), s)
    assert grown is not None
    assert grown.x_centre - grown.x_scale < 5.0 - 1.5 * 5.0
    assert grown.x_centre + grown.x_scale > 10.0
    assert (grown.y_centre, grown.y_scale) == (s.y_centre, s.y_scale)
    observations = [driven.observe((0.1, 0.5, -0.9, 0.9), s) for _ in range(min(UNDER))]
    assert observations[:-1] == [None] * (min(UNDER) - 1)
    shrunk = observations[-1]
    assert shrunk is not None
    assert shrunk.x_scale == pytest.approx(1.1)
    assert shrunk.x_centre == pytest.approx(6.5)
    assert shrunk.y_scale == s.y_scale
    # if only a quarter of the range is unused, the whole memory is required
    driven = DrivenRange()
    patient = [driven.observe((-0.7, 0.7, -0.9, 0.9), s) for _ in range(LONGEST)]
    assert [structure is None for structure in patient] == [True] * (LONGEST - 1) + [False]
    assert patient[-1].x_scale == pytest.approx(5.0 * 0.7 * 1.1)


def test_an_output_beyond_its_range_counts_in_a_piece_without_a_fault_only() -> None:
    driven = DrivenRange(per_piece=2)
    assert [driven.observe((-1.0, 1.0, -3.0, 1.0), wide_enough()), driven.interrupt()] == [None, None]
    assert [driven.observe((-1.0, 1.0, -1.0, 1.0), wide_enough()) for _ in range(4)] == [None] * 4
    assert driven.observe((-1.0, 1.0, -3.0, 1.0), wide_enough()) is None
    assert driven.observe((-1.0, 1.0, -1.0, 1.0), wide_enough()) is not None


@pytest.mark.sample(2)
@pytest.mark.parametrize("mode", ["cyclic", "continuous"])
@pytest.mark.parametrize("guess", [0.5, 3.0])
def test_ranges_given_half_or_three_times_as_wide_are_mended(mode: str, guess: float) -> None:
    errors = []
    for factor in (1.0, guess):
        one = sensor()
        true = structure_for(one)
        s = replace(true, x_scale=factor * true.x_scale, y_scale=factor * true.y_scale)
        state = OperatorState.settled_at(s, true.x_range[0], came_from="above")
        learner = SelfLearningCompensator(
            s,
            0.1,
            4.0,
            0.5,
            "box_active_set",
            one.x_range,
            mode,
            hand_over_s=0.02,
            state=state,  # type: ignore[arg-type]
            solve_delay_samples=5,
        )
        y_ref = steps(one, 90.0)
        errors.append(error_of(learner, y_ref, one.run, one, slice(-8000, None)))
        assert learner.structure.x_scale == pytest.approx(true.x_scale, rel=0.2)
    assert errors[1] < 1.5 * errors[0]


def test_a_model_that_is_given_keeps_its_thresholds() -> None:
    one = sensor()
    s = structure_for(one)
    wide = replace(s, x_scale=3.0 * s.x_scale, y_scale=3.0 * s.y_scale)
    model = HysteresisCreepModel.from_weights(wide, wide.straight_line)
    learner = SelfLearningCompensator(
        wide, 0.1, 1.0, 0.1, "box_active_set", one.x_range, model=model, solve_delay_samples=5
    )
    learner.run(steps(one, 8.0), one.run)
    assert learner.structure == wide
    assert learner_for(one).settings.adapt_range
