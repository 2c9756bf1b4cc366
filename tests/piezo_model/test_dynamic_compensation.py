"""Behind the inverse of the dynamics: a compensator follows after the declared lag, and self-learning compensators and
banks learn the static part."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from known_models import structure, true_model
from ringing_stage import RingingStage, T, recorded, steps

from piezo_model import (
    Compensator,
    CompensatorBank,
    Dynamics,
    HysteresisCreepModel,
    ModelError,
    ModelStructure,
    OperatorState,
    Recording,
    SelfLearningCompensator,
    identify,
    plants,
    signals,
)
from solvers.arrays import Vector

ONE = Dynamics((500.0,), (0.01,), (1.0,), 1.3125 * T)
TWO = Dynamics((120.0, 900.0), (0.03, 0.01), (0.8, 0.15), 0.5 * T, 2e-4)


def model_of(dynamics: Dynamics, **changes: object) -> HysteresisCreepModel:
    return replace(true_model(structure(sample_time=T, **changes)), dynamics=dynamics)


def wave(size: int = 4000) -> np.ndarray:
    t = T * np.arange(size)
    return 8.0 * np.sin(2.0 * np.pi * 40.0 * t) - 3.0 * np.cos(2.0 * np.pi * 13.0 * t)


@pytest.mark.parametrize("dynamics", [ONE, replace(TWO, amplifier_lag_s=0.0)], ids=str)
def test_the_model_behind_its_compensator_is_the_reference_model(dynamics: Dynamics) -> None:
    model = model_of(dynamics)
    compensator, s = Compensator(model, (-100.0, 300.0)), model.structure
    state = compensator.state.copy()
    level = float(model.static.simulate([s.x_centre + s.x_scale * state.play[0]], state)[0])
    behind = dynamics.filter(dynamics.inverse(wave(), T, level), T, level)
    np.testing.assert_allclose(driven(compensator, model, wave()), behind, atol=1e-9)


@pytest.mark.parametrize("dynamics", [ONE, TWO], ids=str)
def test_a_reference_that_is_known_is_followed_without_the_lag_of_an_amplifier(dynamics: Dynamics) -> None:
    model, reference = model_of(dynamics), wave(20_000)
    compensator = Compensator(model, (-100.0, 300.0), dynamics=False)
    y = driven(compensator, model, dynamics.anticipated(reference, T, amplifier=True))
    assert np.std((y - reference)[4000:-4000]) < 0.004 * np.ptp(reference)


def driven(compensator: Compensator, model: HysteresisCreepModel, reference: np.ndarray) -> np.ndarray:
    """Output of a stage that the model describes, in the states in which the compensator begins."""
    state = compensator.state.copy()
    return model.simulate(compensator.run(reference), state)


def test_without_the_inverse_the_drive_is_that_of_the_static_part_without_a_lag() -> None:
    without, static = Compensator(model_of(ONE), dynamics=False), Compensator(model_of(ONE).static)
    assert without.lag_s == static.lag_s == 0.0
    np.testing.assert_array_equal(without.run(wave()), static.run(wave()))


def test_where_a_limit_holds_the_drive_the_inverse_goes_on_from_where_the_stage_is() -> None:
    model = model_of(ONE)
    reference = np.concatenate([np.linspace(-18.0, -10.0, 2000), np.repeat([-10.0, 10.0, -10.0, 10.0, -10.0], 1000)])
    inverse, static = (
        # from 3 ms on after each jump
        np.max(np.abs(driven(compensator, model, reference) - reference).reshape(-1, 1000)[3:, 30:])
        for compensator in (Compensator(model, rate_limit=5e4), Compensator(model.static, rate_limit=5e4))
    )
    assert inverse < 0.02 * 20.0
    assert static > 10.0


def test_references_that_are_no_numbers_hold_the_drive_and_do_no_harm_later() -> None:
    model, reference = model_of(TWO), wave()
    reference[[5, 1000, 1001]] = np.nan, np.inf, -np.inf
    x = Compensator(model).run(reference)
    assert x[1000] == x[999]
    np.testing.assert_allclose(x[-500:], Compensator(model).run(wave())[-500:], atol=1e-3)
    reference[1000] = 1e308
    assert np.all(np.abs(Compensator(model).run(reference) - 50.0) <= 50.0)


@pytest.mark.sample(2)
@pytest.mark.parametrize("off", [0.95, 1.05, 1.0])
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
    k = np.arange(reference.size)
    error = (outputs - np.interp(k - compensator.lag_s / T, k, reference))[4000:]
    assert np.sqrt(np.mean(error**2)) < 0.02 * 40.0


@pytest.mark.parametrize("inverts", [True, False])
@pytest.mark.parametrize(
    "g", [ONE, *(Dynamics((312.0, second), (0.02, 0.01), (0.8, 0.15), 0.6 * T) for second in (1010.0, 4200.0))], ids=str
)
def test_the_largest_gain_of_integral_action_is_that_from_which_on_the_loop_does_not_settle(
    g: Dynamics, inverts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    most = g.largest_gain(T, g.below(T) if inverts else None)
    monkeypatch.setattr(HysteresisCreepModel, "require_stable", lambda *_, **__: None)

    def ringing(gain: float) -> float:
        """How far the output still swings 1.5 s after a step of the reference, in its heights."""
        compensator = Compensator(
            replace(LINE, dynamics=g.below(T)), x_start=56.25, integral_gain=gain, dynamics=inverts
        )
        stage, y = g.stream(T, -5.0), np.empty(17_000)
        for k in range(y.size):
            y[k] = stage(np.array([40.0 * compensator.step(1e-6 * (k > 0) - 5.0) / 150.0 - 20.0]))[0]
            compensator.correct(float(y[k]))
        return 1e6 * float(np.ptp(y[-2000:]))

    assert ringing(0.97 * most) < 1.5
    assert ringing(1.03 * most) > 4.0


def test_a_gain_with_which_the_loop_would_be_unstable_is_refused_and_nothing_changes() -> None:
    model, unstable = model_of(ONE), "integral_gain must be below .* per second, not {}: with a resonance at {}"
    compensator = Compensator(model, integral_gain=1000.0)
    slower = replace(model, dynamics=replace(ONE, frequencies_Hz=(80.0,)))
    for call, sentence in (
        (lambda: Compensator(model, integral_gain=5000.0), unstable.format(5000, "500 Hz")),
        (lambda: Compensator(model.static, integral_gain=5000.0), unstable.format(5000, "500 Hz")),
        (
            lambda: Compensator(model, integral_gain=1000.0, dynamics=False),
            r"below 6[0-9.]+ .* a delay of 131 µs, not inverted, the loop would be",
        ),
        (
            lambda: CompensatorBank(model.structure, 2, dynamics=ONE, integral_gain=5000.0),
            unstable.format(5000, "500 Hz"),
        ),
        (lambda: compensator.change_model(slower), unstable.format(1000, "80")),
    ):
        with pytest.raises(ModelError, match=sentence):
            call()
    assert compensator.model == model
    np.testing.assert_array_equal(compensator.run(wave()), Compensator(model, integral_gain=1000.0).run(wave()))
    for stable, gain in ((model, 1000.0), (model, 0.0), (model.static, 60.0)):
        Compensator(stable, integral_gain=gain)


def test_a_change_of_the_dynamics_or_of_where_the_stage_is_begins_in_balance() -> None:
    model = model_of(ONE, creep_rates=())
    compensator = Compensator(model, integral_gain=10.0)
    compensator.run(np.full(3000, 5.0))
    compensator.change_model(replace(model, dynamics=TWO))
    assert np.ptp(compensator.run(np.full(200, 5.0))) < 1e-6
    compensator.state = OperatorState.settled_at(model.structure, 20.0)
    compensator.correct(0.0)  # the output of no drive
    begun = Compensator(compensator.model, state=compensator.state, integral_gain=10.0)
    np.testing.assert_array_equal(compensator.run(wave()), begun.run(wave()))


S = ModelStructure.equidistant(5, 3, (0.0, 150.0), (-20.0, 20.0), (100.0, 10.0, 1.0), T, offset=True)
LINE = HysteresisCreepModel.from_weights(S, S.straight_line)


def stage(kind: str = "maxwell_slip", dynamics: Dynamics = ONE) -> RingingStage:
    modes = zip(dynamics.frequencies_Hz, dynamics.damping, dynamics.gains, strict=True)
    return RingingStage(kind, [*modes], dynamics.delay_s, level=float(plants.get(kind, sample_time=T).run([0.0])[0]))


def scan(f: float, seconds: float) -> Vector:
    """A triangle of changing height about a changing level, µm, from the end of the range on."""
    t = T * np.arange(round(seconds / T))
    triangle = 2.0 * np.abs(2.0 * ((f * t + 0.25) % 1.0) - 1.0) - 1.0
    moving = (8.5 + 5.5 * np.sin(1.4 * np.pi * t)) * triangle + 2.0 * np.sin(0.46 * np.pi * t)
    return np.concatenate([np.linspace(-19.0, moving[0], 1000), moving])


def learner_of(dynamics: Dynamics | None, s: ModelStructure = S, **options: object) -> SelfLearningCompensator:
    model = replace(HysteresisCreepModel.from_weights(s, s.straight_line), dynamics=dynamics)
    return SelfLearningCompensator(s, model=model, **{"mode": "continuous", "x_limits": (0.0, 150.0), **options})


def error_percent(model: HysteresisCreepModel, kind: str = "maxwell_slip") -> float:
    """Of the static part on a slow decaying triangle, in % of the range."""
    x = signals.decaying_triangle(duration_s=2.0, sample_time=T, low=5, high=145, cycles=10)
    error = plants.get(kind, sample_time=T).run(x) - model.static.simulate(x, OperatorState.settled_at(S, 0.0))
    return float(np.std(error[2000:])) / 0.4


@cache
def best_percent(kind: str = "maxwell_slip") -> float:
    """The same of the model of a slow recording without dynamics."""
    x = signals.decaying_triangle(duration_s=4.0, sample_time=T, low=5, high=145, cycles=20)
    return error_percent(identify(x, plants.get(kind, sample_time=T).run(x), S, dynamics="ignore"), kind)


def learned(
    learner: SelfLearningCompensator, f: float, noise_um: float, kind: str = "maxwell_slip", seconds: float = 5.0
) -> float:
    """Error of what it learned while it scanned."""
    random, plant = np.random.default_rng(9), stage(kind)

    def measured(x: Vector) -> Vector:
        y = plant.run(x) + noise_um * random.standard_normal(x.size)
        return np.where(random.random(x.size) < 1e-3, np.nan, y)

    learner.run(scan(f, seconds), measured)
    return error_percent(learner.model, kind)


@pytest.mark.parametrize("kind", ["maxwell_slip", "relay_preisach"])
@pytest.mark.parametrize("f", [20.0, 100.0])
def test_a_scan_teaches_the_static_part_nearly_as_well_as_a_slow_recording(kind: str, f: float) -> None:
    dynamics = replace(ONE, frequencies_Hz=(515.0,), damping=(0.013,), delay_s=1.5 * T)  # not quite those of the stage
    *known, unknown = (learned(learner_of(g), f, 0.02, kind) / best_percent(kind) for g in (ONE, dynamics, None))
    assert max(known) < 3.0
    assert unknown > 5.0


@pytest.mark.sample(1)
@pytest.mark.parametrize("integral_gain", [500.0, 0.0])
def test_noise_of_a_hundredth_of_the_range_does_not_bias_what_is_learned_and_three_hardly(integral_gain: float) -> None:
    hundredth, three = (
        learned(learner_of(ONE, integral_gain=integral_gain), 50.0, noise_um, seconds=2.0) for noise_um in (0.4, 1.2)
    )
    assert hundredth < 3.0 * best_percent()
    assert three < 4.0 * best_percent()


def test_cyclic_operation_needs_no_subtraction_at_noise_of_a_hundredth_of_the_range() -> None:
    learner = learner_of(ONE, mode="cyclic", reset_s=0.1, build_s=2.0, learn_s=0.4)
    assert learned(learner, 50.0, 0.4, seconds=5.5) < 4.0 * best_percent()


def test_a_restored_bank_and_learner_compute_with_the_dynamics_that_they_state() -> None:
    other = replace(ONE, frequencies_Hz=(510.0,), damping=(0.02,))
    reference = scan(30.0, 0.5)
    banks = [CompensatorBank(S, 11, dynamics=dynamics) for dynamics in (ONE, other)]
    for each in banks:
        each.remove(4)
    bank, same = banks
    state = bank.get_state()
    state["dynamics"][:] = same.get_state()["dynamics"]
    bank.restore(state)
    measured = np.repeat(0.9 * reference[:, None], 10, axis=1)
    np.testing.assert_array_equal(bank.run(measured, measured), same.run(measured, measured))
    learner, same_learner = learner_of(ONE), learner_of(other)
    saved = learner.get_state()
    saved["compensator"]["model"]["dynamics"] = other.__dict__
    learner.restore(saved)
    np.testing.assert_array_equal(*(each.replay(reference, 0.9 * reference) for each in (learner, same_learner)))
    late, fast, wild = (bank.get_state() for _ in range(3))
    late["dynamics"][3]["dynamics"] = {**other.to_dict(), "delay_s": 0.5}
    fast["dynamics"][3]["dynamics"] = {**other.to_dict(), "frequencies_Hz": [0.36 / T]}
    wild["core"].view(np.float64)[bank._core.offsets["prefilter"][0] // 8] = 1e101
    saved["compensator"]["prefilter"][-1] = 1e101
    for one, wrong, why in (
        (bank, late, "the bank has room for 1 modes and the lag of its own"),
        (bank, fast, "the resonance at 3600 Hz is above 35 % of the sampling rate"),
        (bank, wild, "a count or a number in it cannot be"),
        (learner, saved, r"the state of the dynamics must be \d+ numbers of at most 1e\+100 in size"),
    ):
        with pytest.raises(ValueError, match=why):
            one.restore(wrong)
