import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_models import Case, cases

from piezo_model.compensator import Compensator
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.structure import ModelStructure


def chunks(case: Case, values: np.ndarray) -> list[np.ndarray]:
    return np.split(values, np.sort(case.rng.integers(0, values.size, 3)))


@settings(max_examples=40)
@given(cases())
def test_sample_by_sample_and_in_chunks_the_drive_is_the_same(case: Case) -> None:
    y_ref = case.reference(60)
    whole = Compensator(case.model, state=case.state).run(y_ref)
    by_chunk, by_sample = (Compensator(case.model, state=case.state) for _ in range(2))
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
    x = Compensator(case.model, state=case.state).run(y_ref)
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


def test_the_state_handed_in_is_copied(model: HysteresisCreepModel) -> None:
    state = OperatorState.settled_at(model.structure, 75.0)
    Compensator(model, state=state).run([1.0, -3.0])
    np.testing.assert_array_equal(state.play, np.full(8, 0.5))
