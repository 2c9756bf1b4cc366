import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_models import FREE, Case, cases

from piezo_model.bank import CompensatorBank
from piezo_model.compensator import Compensator
from piezo_model.learning.settings import Mode
from piezo_model.model import HysteresisCreepModel, ModelError
from piezo_model.operator_state import OperatorState
from piezo_model.self_learning import SelfLearningCompensator
from piezo_model.structure import ModelStructure


def chunks(case: Case, values: np.ndarray) -> list[np.ndarray]:
    return np.split(values, np.sort(case.rng.integers(0, values.size, 3)))


@settings(max_examples=40)
@given(cases())
def test_sample_by_sample_and_in_chunks_the_drive_is_the_same(case: Case) -> None:
    y_ref = case.reference(60)
    whole = Compensator(case.model, FREE, state=case.state).run(y_ref)
    by_chunk, by_sample = (Compensator(case.model, FREE, state=case.state) for _ in range(2))
    np.testing.assert_array_equal(np.concatenate([by_chunk.run(part) for part in chunks(case, y_ref)]), whole)
    np.testing.assert_allclose([by_sample.step(y) for y in y_ref], whole, rtol=0, atol=case.x_tolerance)


@settings(max_examples=40)
@given(cases())
def test_the_states_are_those_of_the_actuator_that_saw_the_limited_drive(case: Case) -> None:
    s = case.structure
    limits = (s.x_centre - 0.3 * s.x_scale, s.x_centre + 0.4 * s.x_scale)
    rate = 0.05 * s.x_scale / s.sample_time
    compensator = Compensator(case.model, limits, rate, case.state)
    x = compensator.run(case.reference())
    actuator = case.model.advance(x, case.state)[1]
    np.testing.assert_allclose(compensator.state.play, actuator.play, rtol=0, atol=1e-12)
    np.testing.assert_allclose(compensator.state.creep, actuator.creep, rtol=0, atol=1e-12)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@settings(max_examples=20)
@given(case=cases(), where=st.integers(0, 39))
def test_a_reference_that_is_not_finite_holds_the_drive(bad: float, case: Case, where: int) -> None:
    y_ref = case.reference(40)
    y_ref[where] = bad
    x = Compensator(case.model, FREE, state=case.state).run(y_ref)
    before = x[where - 1] if where else case.structure.x_centre + case.structure.x_scale * case.state.play[0]
    assert np.all(np.isfinite(x))
    assert x[where] == pytest.approx(before, rel=0, abs=case.x_tolerance)
    y = case.model.simulate(x, case.state)
    others = np.arange(40) != where
    np.testing.assert_allclose(y[others], y_ref[others], rtol=0, atol=case.y_tolerance)


@pytest.fixture
def model() -> HysteresisCreepModel:
    structure = ModelStructure.equidistant(
        n=2, m=1, x_range=(0, 100), y_range=(-10, 10), creep_rates=(1.0,), sample_time=1e-3
    )
    return HysteresisCreepModel.from_weights(structure, structure.straight_line)


def first_drives(model: HysteresisCreepModel, y_ref: float, **start: float | None) -> list[float]:
    """The first drive of everything that drives, at a rate limit of 0.1 V a sample."""
    s, limits = model.structure, {"rate_limit": 100.0, **start}
    modes: tuple[Mode, ...] = ("cyclic", "continuous")
    return [
        Compensator(model, **limits).step(y_ref),
        float(Compensator(model, **limits).run([y_ref])[0]),
        *(SelfLearningCompensator(s, mode=mode, **limits).step(y_ref, math.nan) for mode in modes),
        *(float(SelfLearningCompensator(s, mode=mode, **limits).replay([y_ref], [math.nan])[0]) for mode in modes),
        float(CompensatorBank(s, 1, **limits).step([y_ref], [math.nan])[0]),
    ]


@pytest.mark.parametrize(("start", "at"), [({}, 0.0), ({"x_start": 40.0}, 40.0), ({"x_limits": (3.0, 90.0)}, 3.0)])
def test_the_first_drive_is_a_step_of_the_rate_limit_away_from_where_the_stage_is(
    model: HysteresisCreepModel, start: dict[str, Any], at: float
) -> None:
    np.testing.assert_allclose(first_drives(model, 9.0, **start), at + 0.1, rtol=0, atol=1e-12)
    np.testing.assert_allclose(first_drives(model, math.nan, **start), at, rtol=0, atol=1e-12)


def test_without_limits_given_the_drive_stays_within_the_range_of_the_model(model: HysteresisCreepModel) -> None:
    assert Compensator(model).run([-50.0, 50.0]).tolist() == list(model.structure.x_range)


def test_the_states_before_a_recording_are_for_a_model_that_has_them(model: HysteresisCreepModel) -> None:
    start = OperatorState.settled_at(model.structure, 30.0, came_from="below")
    known = replace(model, start=start)
    for chosen in ("recording", None):
        np.testing.assert_array_equal(known.initial_state(chosen).play, start.play)
    for state in (known.initial_state("rest"), model.initial_state("rest"), model.initial_state()):
        np.testing.assert_array_equal(state.play, Compensator(model).state.play)
    with pytest.raises(ModelError, match="no states from before a recording; begin at rest"):
        model.initial_state("recording")


def test_the_state_handed_in_is_copied(model: HysteresisCreepModel) -> None:
    state = OperatorState.settled_at(model.structure, 75.0)
    Compensator(model, state=state).run([1.0, -3.0])
    np.testing.assert_array_equal(state.play, OperatorState.settled_at(model.structure, 75.0).play)
