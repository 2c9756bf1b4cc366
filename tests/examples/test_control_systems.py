"""Model, inverse and compensator in python-control: the same trajectories, alone, in series and in a closed loop."""

import numpy as np
import pytest
from command_line import run_example
from exported_loops import a_model
from hypothesis import given, settings
from programs import library
from random_models import Case, cases, drive

from piezo_model import Compensator, ModelStructure, OperatorState

control = library("control")
from control_systems import compensator_system, initial_states, inverse_system, model_system  # noqa: E402

SAMPLES = 60


def response(system, u: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.asarray(control.input_output_response(system, np.arange(u.size) * system.dt, u, z).outputs)


@given(cases())
@settings(max_examples=15)
def test_the_system_of_any_model_simulates_as_the_model_does(case: Case) -> None:
    s, x = case.structure, case.a_drive(SAMPLES)
    found = response(model_system(case.model), x, initial_states(s, case.state))
    np.testing.assert_allclose(found, case.model.simulate(x, case.state), rtol=0.0, atol=1e-12 * s.y_scale)


@given(cases())
@settings(max_examples=15)
def test_inverse_and_model_in_series_are_the_identity(case: Case) -> None:
    s = case.structure
    series = control.series(inverse_system(case.model), model_system(case.model))
    z = initial_states(s, case.state)
    y_ref = s.y_centre + 0.5 * s.y_scale * drive(case.rng, SAMPLES)
    np.testing.assert_allclose(response(series, y_ref, np.concatenate([z, z])), y_ref, rtol=0.0, atol=1e-10 * s.y_scale)


def test_a_compensator_keeps_its_limits_and_is_only_read() -> None:
    compensator = Compensator(a_model(), x_limits=(20.0, 120.0), rate_limit=3e4)
    before, y_ref = compensator.get_state(), 22.0 * np.sin(np.arange(400) / 15.0)
    z = initial_states(compensator.model.structure, compensator.state)
    found = response(compensator_system(compensator), y_ref, z)
    np.testing.assert_equal(compensator.get_state(), before)
    np.testing.assert_array_equal(found, compensator.run(y_ref))
    assert (found.min(), found.max()) == pytest.approx((20.0, 120.0), abs=1e-13)


def test_a_reference_that_is_not_finite_holds_the_drive() -> None:
    """By the system's own maps, since python-control's responses interpolate inputs and so spread what is not
    finite."""
    compensator = Compensator(a_model(), x_limits=(0.0, 150.0))
    system, z = compensator_system(compensator), initial_states(compensator.model.structure)
    for y_ref in (5.0, np.nan, np.inf, -5.0):
        assert system.output(0.0, z, [y_ref]) == compensator.step(y_ref)
        z = system.dynamics(0.0, z, [y_ref])


def test_a_closed_loop_with_a_plant_has_our_trajectory() -> None:
    """An integrating controller with the usual delay of one sample round a compensator and a plant that it fits
    badly."""
    model, plant = a_model(), a_model(seed=4)
    s, gain = model.structure, 0.3
    controller = control.nlsys(
        lambda t, z, u, params: z + gain * (u[0] - u[1]),
        lambda t, z, u, params: z,
        inputs=["wanted", "displacement"],
        outputs=["reference"],
        states=["sum"],
        dt=s.sample_time,
        name="controller",
    )
    # The controller's output is its state, so the loop is no algebraic one.
    loop = control.interconnect(
        [controller, compensator_system(Compensator(model, (0.0, 150.0))), model_system(plant)],
        inputs=["wanted"],
        outputs=["displacement"],
    )
    wanted = 12.0 * np.sign(np.sin(np.arange(300) / 25.0))
    z = np.concatenate([[0.0], initial_states(s), initial_states(s)])
    found = response(loop, wanted, z)

    compensator, state, total = Compensator(model, (0.0, 150.0)), OperatorState.before_drive(s), 0.0
    expected = np.empty(wanted.size)
    for k in range(wanted.size):
        (expected[k],), state = plant.advance([compensator.step(total)], state)
        total += gain * (wanted[k] - expected[k])
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)
    assert abs(expected[70] - wanted[70]) < 0.05


def test_the_states_of_another_structure_are_refused() -> None:
    other = ModelStructure.equidistant(n=12, m=1, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(), sample_time=1e-3)
    with pytest.raises(ValueError, match="those of another structure"):
        initial_states(a_model().structure, OperatorState.settled_at(other, 0.0))


def test_run_alone_the_compensator_follows_and_the_straight_line_does_not() -> None:
    compensated, straight = (
        float(line.split()[-2]) for line in run_example("adapters/control_systems.py").splitlines()
    )
    assert compensated < 0.1 * straight
