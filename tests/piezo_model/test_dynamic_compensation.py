import copy
from dataclasses import replace

import numpy as np
import pytest
from known_models import structure, true_model
from ringing_stage import RingingStage, T, recorded, steps

from piezo_model import Compensator, Dynamics, HysteresisCreepModel, Recording, identify

ONE = Dynamics((500.0,), (0.01,), (1.0,), 1.3125 * T)
TWO = Dynamics((120.0, 900.0), (0.03, 0.01), (0.8, 0.15), 0.5 * T, 2e-4)


def model_of(dynamics: Dynamics, **changes: object) -> HysteresisCreepModel:
    return replace(true_model(structure(sample_time=T, **changes)), dynamics=dynamics)


def wave(size: int = 4000) -> np.ndarray:
    t = T * np.arange(size)
    return 8.0 * np.sin(2.0 * np.pi * 40.0 * t) - 3.0 * np.cos(2.0 * np.pi * 13.0 * t)


def delayed(y: np.ndarray, lag_s: float) -> np.ndarray:
    k = np.arange(y.size)
    return np.interp(k - lag_s / T, k, y)


def squares(size: float = 10.0) -> np.ndarray:
    return np.concatenate([np.linspace(-18.0, -size, 2000), np.repeat([-size, size, -size, size, -size], 1000)])


@pytest.mark.parametrize("dynamics", [ONE, replace(TWO, amplifier_lag_s=0.0)], ids=str)
def test_the_model_behind_its_compensator_is_the_reference_model(dynamics: Dynamics) -> None:
    model = model_of(dynamics)
    compensator = Compensator(model, (-100.0, 300.0))
    state = compensator.state.copy()
    level = float(model.static.simulate([model.structure.x_centre + model.structure.x_scale * state.play[0]], state)[0])
    reference = wave()
    y = model.simulate(compensator.run(reference), state)
    np.testing.assert_allclose(y, dynamics.reference(reference, T, level), atol=1e-9)


@pytest.mark.parametrize("dynamics", [ONE, TWO], ids=str)
def test_a_slow_reference_is_followed_after_the_declared_lag(dynamics: Dynamics) -> None:
    model = model_of(dynamics)
    compensator = Compensator(model, (-100.0, 300.0))
    state, reference = compensator.state.copy(), 10.0 * np.sin(2.0 * np.pi * 2.0 * T * np.arange(20_000))
    error = model.simulate(compensator.run(reference), state) - delayed(reference, compensator.lag_s)
    assert np.max(np.abs(error[4000:])) < 0.02
    assert Compensator(model, dynamics=False).lag_s == Compensator(model.static).lag_s == 0.0


def test_without_the_inverse_the_drive_is_that_of_the_static_part() -> None:
    model = model_of(ONE)
    static = Compensator(model.static).run(wave())
    np.testing.assert_array_equal(Compensator(model, dynamics=False).run(wave()), static)


def test_where_a_limit_holds_the_drive_the_inverse_goes_on_from_where_the_stage_is() -> None:
    model, reference = model_of(ONE), squares()
    compensator = Compensator(model, rate_limit=5e4)
    state = compensator.state.copy()
    y = model.simulate(compensator.run(reference), state)
    late = np.abs(y - reference).reshape(-1, 1000)[3:, 30:]  # from 3 ms on after each jump
    assert np.max(late) < 0.02 * 20.0
    static = model.simulate(Compensator(model.static, rate_limit=5e4).run(reference), state)
    assert np.max(np.abs(static - reference).reshape(-1, 1000)[3:, 30:]) > 10.0


def test_references_that_are_no_numbers_hold_the_drive_and_do_no_harm_later() -> None:
    model, reference = model_of(TWO), wave()
    reference[[5, 1000, 1001]] = np.nan, np.inf, -np.inf
    x = Compensator(model).run(reference)
    assert x[1000] == x[999]
    np.testing.assert_allclose(x[-500:], Compensator(model).run(wave())[-500:], atol=1e-3)
    reference[1000] = 1e308
    x = Compensator(model).run(reference)
    assert np.all((x >= 0.0) & (x <= 100.0))


@pytest.mark.parametrize("off", [0.95, 1.0, 1.05])
def test_integral_action_is_stable_with_a_frequency_that_is_wrong_by_a_twentieth(off: float) -> None:
    x = steps(20_000, 3)
    y = recorded("maxwell_slip", x, [(500.0, 0.01, 1.0)], ONE.delay_s, 0.02, 4)
    model = identify(Recording.from_arrays(x, y, T), n=5, m=3, creep_rates=(), dynamics=ONE)
    model = replace(model, dynamics=replace(ONE, frequencies_Hz=(500.0 * off,)))
    compensator, stage = (
        Compensator(model, integral_gain=1000.0),
        RingingStage("maxwell_slip", [(500.0, 0.01, 1.0)], ONE.delay_s),
    )
    reference, y = np.concatenate([np.linspace(-19.0, 0.0, 2000), np.zeros(500), wave(6000)]), np.nan
    outputs = np.empty(reference.size)
    for k, y_ref in enumerate(reference.tolist()):
        compensator.correct(y)
        outputs[k] = y = stage.step(compensator.step(y_ref))
    error = (outputs - delayed(reference, compensator.lag_s))[4000:]
    assert np.sqrt(np.mean(error**2)) < 0.02 * 40.0


def test_a_gain_that_would_excite_a_resonance_is_refused_without_the_inverse() -> None:
    model = model_of(ONE)
    Compensator(model, integral_gain=1000.0)
    Compensator(model, integral_gain=60.0, dynamics=False)
    with pytest.raises(ValueError, match=r"at most 2 ζ ω = 62\.8 per second beside a resonance at 500 Hz"):
        Compensator(model, integral_gain=1000.0, dynamics=False)


@pytest.mark.parametrize("gain", [0.0, 500.0])
def test_a_copy_and_a_restored_compensator_continue_to_the_bit(gain: float) -> None:
    compensator, reference = Compensator(model_of(TWO), rate_limit=2e4, integral_gain=gain), wave()
    for y_ref in reference[:1000]:
        compensator.correct(0.9 * y_ref)
        compensator.step(y_ref)
    restored = Compensator(model_of(TWO), rate_limit=2e4, integral_gain=gain)
    restored.restore(compensator.get_state())
    copied, expected = copy.deepcopy(compensator), []
    for part in (compensator, restored, copied):
        drives = []
        for y_ref in reference[1000:2000]:
            drives.append(part.step(y_ref))
            part.correct(0.9 * y_ref)
        expected.append(drives)
    assert expected[0] == expected[1] == expected[2]
    with pytest.raises(ValueError, match="the state of the dynamics must be"):
        restored.restore({**compensator.get_state(), "prefilter": np.zeros(2)})


def test_a_change_of_the_dynamics_begins_in_balance() -> None:
    model = model_of(ONE, creep_rates=())
    compensator = Compensator(model)
    compensator.run(np.full(3000, 5.0))
    compensator.change_model(replace(model, dynamics=TWO))
    assert np.ptp(compensator.run(np.full(200, 5.0))) < 1e-6
