"""Integral action beside the compensator: response to a disturbance, at the limits, and without valid samples."""

from dataclasses import replace

import numpy as np
import pytest
from faulty_sensor import steps
from learning_loops import MODES, T, learner_for, sensor, structure_for

from piezo_model import Compensator, HysteresisCreepModel
from piezo_model.compensator import CORRECTION

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
    np.testing.assert_allclose(error[:40], 0.0, atol=1e-11)
    np.testing.assert_allclose(error[40:], -0.5 * (1.0 - GAIN) ** np.arange(40), atol=1e-11)


def test_the_fastest_disturbance_is_amplified_by_no_more_than_the_stated_peak() -> None:
    error = closed(np.zeros(200), 0.1 * (-1.0) ** np.arange(200), GAIN)[1]
    assert np.abs(error[100:]).max() == pytest.approx(0.1 * 2.0 / (2.0 - GAIN), rel=1e-6)


def test_the_integral_stops_while_the_limits_hold_the_drive() -> None:
    y_ref = np.concatenate([np.full(300, 60.0), np.full(20, 1.0), np.full(300, -60.0), np.full(20, 1.0)])
    x, error = closed(y_ref, np.zeros(y_ref.size), GAIN)
    assert (x.min(), x.max()) == LIMITS
    np.testing.assert_allclose(error[300:320], 0.0, atol=1e-10)
    np.testing.assert_allclose(error[620:], 0.0, atol=1e-10)


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
        plant, learner, done = sensor(), learner_for(sensor(), mode, integral_gain=gain), [0]

        def moved(x: np.ndarray, plant=plant, done=done) -> np.ndarray:  # type: ignore[no-untyped-def]
            done[0] += x.size
            return plant.run(x) + added[done[0] - x.size : done[0]]

        x, y = learner.run(y_ref, moved)
        errors.append(float(np.sqrt(np.mean((y - y_ref)[-5000:] ** 2))))
    assert errors[1] < 0.2 * errors[0]
    replayed = learner_for(sensor(), mode, integral_gain=GAIN / T).replay(y_ref, np.append(np.nan, y[:-1]))
    np.testing.assert_array_equal(replayed, x)
