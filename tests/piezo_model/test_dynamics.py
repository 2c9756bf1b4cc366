"""Dynamics of a stage: their filter, its inverse and what does not know them; which dynamics a recording determines."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from known_models import a_drive, reloaded, structure, true_model
from ringing_stage import T, on_a_spring, recorded, steps, through_modes

from piezo_model import (
    Compensator,
    CompensatorBank,
    Dynamics,
    HysteresisCreepModel,
    IdentificationError,
    ModelStructure,
    OperatorState,
    Recording,
    identify,
    plants,
    signals,
)
from piezo_model.identification.dynamics_parameters import Parameters
from piezo_model.identification.forward import Box
from piezo_model.identification.resonance import GAIN, Spectra
from piezo_model.operators import play

ONE = Dynamics((500.0,), (0.01,), (1.0,), 1.3125 * T)
TWO = Dynamics((120.0, 900.0), (0.03, 0.01), (0.8, 0.15), 0.5 * T)
DELAY = Dynamics((), (), (), 2.0 * T)
SLOW = Dynamics((11.0,), (0.02,), (0.9,), 3e-3, 4e-3)
"""For the known models, whose sampling period is 5 ms."""


def modes(dynamics: Dynamics) -> list[tuple[float, float, float]]:
    return list(zip(dynamics.frequencies_Hz, dynamics.damping, dynamics.gains, strict=True))


def ringing(**changes: object) -> HysteresisCreepModel:
    return replace(true_model(structure(**changes)), dynamics=SLOW)


@pytest.mark.parametrize("level", [None, 7.0])
@pytest.mark.parametrize("dynamics", [ONE, replace(TWO, gains=(0.8, 0.2)), DELAY], ids=str)
def test_the_filter_is_the_response_of_the_stage_to_a_held_drive(dynamics: Dynamics, level: float | None) -> None:
    v = np.cumsum(np.random.default_rng(1).normal(size=3000))
    expected = through_modes(v, modes(dynamics), dynamics.delay_s, level=level)
    np.testing.assert_allclose(dynamics.filter(v, T, level), expected, atol=1e-9)


@pytest.mark.parametrize("dynamics", [ONE, TWO, DELAY], ids=str)
def test_a_signal_in_parts_and_columns_is_filtered_as_a_whole(dynamics: Dynamics) -> None:
    v = np.cumsum(np.random.default_rng(2).normal(size=(1000, 3)), axis=0)
    follow = dynamics.stream(T)
    parts = np.concatenate([follow(part) for part in np.split(v, [1, 2, 600])])
    np.testing.assert_array_equal(parts, dynamics.filter(v, T))
    np.testing.assert_allclose(parts[:, 1], dynamics.filter(v[:, 1], T), atol=1e-12)


@pytest.mark.parametrize("dynamics", [ONE, TWO, DELAY, replace(TWO, amplifier_lag_s=3e-4)], ids=str)
def test_behind_the_inverse_a_ramp_is_followed_after_the_declared_lag_and_a_step_hardly_overshoots(
    dynamics: Dynamics,
) -> None:
    ramp, step = np.arange(20_000.0), np.r_[np.zeros(10), np.ones(5000)]
    followed, answer = (dynamics.filter(dynamics.amplified(dynamics.inverse(v, T), T), T) for v in (ramp, step))
    assert (ramp - followed)[-1] == pytest.approx(dynamics.lag_s(T) / T, abs=1e-6)
    assert answer.max() < 1.1
    assert answer[-1] == pytest.approx(1.0, abs=1e-6)


def test_a_model_simulates_its_dynamics_from_the_balance_before_the_first_sample() -> None:
    model, x = ringing(), a_drive()
    state = OperatorState.settled_at(model.structure, 20.0)
    held = model.simulate(np.full(50, 20.0), state)
    np.testing.assert_allclose(held, held[0], atol=1e-12)
    static = model.static.simulate(np.r_[20.0, SLOW.amplified(x, 5e-3, 20.0)], state)
    np.testing.assert_allclose(model.simulate(x, state), SLOW.filter(static[1:], 5e-3, static[0]), atol=1e-9)


def test_each_part_of_a_recording_begins_in_balance() -> None:
    model, x = ringing(), a_drive()
    start = OperatorState.settled_at(model.structure, x[0])
    y = np.tile(model.simulate(x, start), 2)
    recording = replace(Recording.from_arrays(np.r_[x, x], y, 5e-3), starts=(0, x.size))
    np.testing.assert_allclose(model.simulate(recording, start), y, atol=1e-9)
    assert model.validate(recording).fit.rms_percent < 0.05 < model.static.validate(recording).fit.rms_percent


@pytest.mark.sample(2)
@pytest.mark.parametrize("drive", ["triangles", "steps"])
@pytest.mark.parametrize("seed", range(3))
def test_parts_that_begin_while_the_stage_moves_or_rings_are_described_to_their_noise(drive: str, seed: int) -> None:
    rng, t = np.random.default_rng(seed), T * np.arange(36_000)
    triangles = drive == "triangles"
    x = 150.0 * np.abs(2.0 * (rng.uniform(10.0, 30.0) * t % 1.0) - 1.0) if triangles else steps(t.size, seed)
    f, damping = rng.uniform(200.0, 700.0), rng.uniform(0.005, 0.03)
    y = through_modes(0.2 * x, [(f, damping, 1.0)], 0.5 * T) + 0.03 * rng.normal(size=x.size)  # 0.1 % of the range
    first, second = (Recording.from_arrays(x[at], y[at], T) for at in (slice(6031, 21_000), slice(21_000, None)))
    model = identify(replace(first, starts=(0, 7_000)), n=2, m=1, creep_rates=())
    assert_mode(model.dynamics, f, 2e-3, damping, 0.05)
    for fit in (model.report["fit"], vars(model.validate(second).fit)):
        assert fit["rms"] == pytest.approx(0.03, rel=0.05)
        assert fit["max"] < 6.0 * fit["rms"]


def test_at_another_sampling_period_a_mode_too_fast_is_its_static_gain_and_other_dynamics_stay(tmp_path: Path) -> None:
    model = replace(ringing(), dynamics=Dynamics((4.0, 11.0), (0.02, 0.3), (0.6, 0.3), 3e-3, 4e-3))
    slower = model.at(0.05)
    loaded = reloaded(slower, tmp_path)
    assert "only the static gain of the fastest modes" in loaded.warning
    np.testing.assert_array_equal(loaded.simulate(a_drive()), slower.simulate(a_drive()))
    assert (slower.dynamics, slower.left_out) == (Dynamics((4.0,), (0.02,), (0.6,), 3e-3, 4e-3), model.dynamics)
    assert slower.at(0.1).left_out == model.dynamics
    ramp = np.linspace(0.0, 90.0, 40_000)
    np.testing.assert_allclose(slower.simulate(ramp[9::10])[400:], model.simulate(ramp)[9::10][400:], atol=5e-3)
    assert [slower.require_stable(0.1, inverts=inverts) for inverts in (True, False)] == [
        model.dynamics.largest_gain(0.05, inverted) for inverted in (slower.dynamics, None)
    ]


def test_at_another_sampling_period_a_model_keeps_its_dynamics_and_says_what_its_delay_may_be_wrong_by() -> None:
    model = ringing()
    assert model.at(1e-3).dynamics == SLOW
    assert model.at(5e-3).warning == model.at(1e-3).at(5e-3).warning == ""
    for sample_time, off in ((1e-3, "4 ms too long"), (0.01, "5 ms too short")):
        changed = model.at(sample_time)
        assert f"with a sample every 5 ms and has one every {1e3 * sample_time:g} ms: its delay" in changed.warning
        assert f"and is {off} if the sensor is read at the start of the interval." in changed.warning
    assert replace(model, dynamics=None).at(1e-3).warning == ""


@pytest.mark.parametrize(
    "dynamics",
    [Dynamics((1.0, 1.01), (0.01, 0.01), (0.5, 0.5), 1.0), Dynamics((500.0,), (0.01,), (1.0,), 0.0, 5e-324)],
    ids=["longest", "shortest"],
)
def test_the_longest_lag_and_the_shortest_one_can_be_compensated(dynamics: Dynamics) -> None:
    model, reference = replace(true_model(structure(sample_time=T)), dynamics=dynamics), np.linspace(-5.0, 5.0, 50)
    bank = CompensatorBank(model.structure, 1, dynamics=dynamics)
    bank.set_model(0, model)
    np.testing.assert_array_equal(bank.run(reference[:, None])[:, 0], Compensator(model).run(reference))


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", range(2))
def test_a_recording_of_ten_thousand_times_the_period_gives_the_same_model(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.repeat(rng.uniform(0.0, 100.0, 40), 30)
    late = Dynamics((), (), (), *rng.uniform(0.0, 4e-3, 2))
    y = replace(true_model(structure(sample_time=1e-3, creep_rates=())), dynamics=late).simulate(x)
    fast, slow = (identify(Recording.from_arrays(x, y, T), creep_rates=()) for T in (1e-3, 10.0))
    assert slow.report["fit"]["rms_percent"] == pytest.approx(fast.report["fit"]["rms_percent"], rel=0.01, abs=1e-6)
    found, expected = slow.dynamics, (1e4 * fast.dynamics.delay_s, 1e4 * fast.dynamics.amplifier_lag_s)
    assert (found.delay_s, found.amplifier_lag_s) == pytest.approx(expected, rel=1e-3)


@given(st.data(), st.integers(0, 2), st.booleans(), st.floats(1e-5, 10.0))
def test_every_point_of_the_box_of_a_search_and_a_step_beyond_it_is_a_stage(
    data: st.DataObject, count: int, residual: bool, period: float
) -> None:
    f = np.sort(data.draw(arrays(int, count, elements=st.integers(1, 3500), unique=True))) / (1e4 * period)
    zeta, late = (
        data.draw(arrays(float, count, elements=st.floats(1e-3, 0.9))),
        data.draw(st.floats(0.0, 30.0)) * period,
    )
    begun = Dynamics(f, zeta, np.full(count, 1.0 / max(count, 1)), late, late)
    box = Box(*(near := Parameters(begun, period, True, residual and count > 0, True)).bounds)
    theta = box.lb + data.draw(arrays(float, box.lb.size, elements=st.floats(0.0, 1.0))) * (box.ub - box.lb)
    for along in np.eye(theta.size):
        at, made = box.step(theta, along)
        np.testing.assert_allclose(at, box.project(theta + np.copysign(max(abs(made), 1e-6), made) * along), rtol=1e-12)
        for point in (at, theta + 1e3 * along, theta - 1e3 * along):
            near.at(box.project(point))  # whose dynamics refuse what is out of order or range


SIZE = 20_000
PLANTS = ("maxwell_slip", "relay_preisach", "bouc_wen", "duhem", "dense_prandtl_ishlinskii")
Modes = tuple[tuple[float, float, float], ...]
MODE: Modes = ((500.0, 0.01, 1.0),)
DELAY_S = 1.3125 * T


def triangle(size: int, seed: int) -> np.ndarray:
    return signals.decaying_triangle(
        duration_s=size * T, sample_time=T, low=0.0, high=150.0, cycles=10.0 * size * T, final_share=0.05
    )


def tones(size: int, seed: int) -> np.ndarray:
    t, rng = np.arange(size) * T, np.random.default_rng(seed)
    total = sum(
        np.sin(2 * np.pi * f * t + rng.uniform(0.0, 6.28)) / np.sqrt(f) for f in (1, 2, 5, 10, 20, 50, 100, 200)
    )
    return 75.0 + 75.0 * total / np.abs(total).max()


def sweep(size: int, seed: int) -> np.ndarray:
    t = np.arange(size) * T
    rate = np.log(500.0) / t[-1]
    f = np.exp(rate * t)
    return 75.0 - 75.0 / np.maximum(1.0, f / 50.0) * np.cos(2 * np.pi * (f - 1.0) / rate)


def binary_on_levels(size: int, seed: int) -> np.ndarray:
    bits = np.random.default_rng(seed).choice([-1.0, 1.0], size // 20 + 1)
    return np.clip(0.9 * steps(size, seed, 0.25) + 7.5 + 3.75 * np.repeat(bits, 20)[:size], 0.0, 150.0)


DRIVES: dict[str, Callable[[int, int], np.ndarray]] = {
    "triangle": triangle,
    "tones": tones,
    "sweep": sweep,
    "binary": binary_on_levels,
    "steps": steps,
}


def made(
    kind: str,
    drive: str,
    modes: Modes,
    noise_um: float = 0.02,
    seed: int = 31,
    size: int = SIZE,
) -> Recording:
    x = DRIVES[drive](size, seed)
    return Recording.from_arrays(x, recorded(kind, x, modes, DELAY_S, noise_um, seed + 1), T)


def assert_mode(found: Dynamics, f: float, rel_f: float, damping: float, rel_damping: float) -> None:
    """The frequency and the damping of the first mode, to relative errors."""
    assert (found.frequencies_Hz[0], found.damping[0]) == (
        pytest.approx(f, rel=rel_f),
        pytest.approx(damping, rel=rel_damping),
    )


@pytest.mark.sample(2)
@pytest.mark.parametrize("drive", ["steps", "binary", "sweep"])
@pytest.mark.parametrize("kind", PLANTS[:2])
def test_a_resonance_is_in_the_model_and_predicts_steps_that_it_has_not_seen(kind: str, drive: str) -> None:
    model = identify(made(kind, drive, MODE, size=2 * SIZE))
    assert_mode(model.dynamics, 500.0, 2e-3, 0.01, 0.1)
    assert model.dynamics.delay_s == pytest.approx(DELAY_S, abs=0.2 * T)
    assert model.validate(made(kind, "steps", MODE, 0.0, seed=77, size=20_000)).fit.rms_percent < 1.0
    found = rf"has a resonance at {model.dynamics.frequencies_Hz[0]:.5g} Hz .* by up to (4[5-9]|5[0-5]) times"
    assert re.search(found, " ".join(model.report["sentences"]))
    chosen = next(row for row in model.report["selection"]["table"] if row["standing"])
    assert chosen["error_percent"] < 2.0 * model.report["fit"]["rms_percent"]  # not behind an inverse that adds noise
    known = zip((500.0, 0.01, DELAY_S), model.report["dynamics"]["intervals"].values(), strict=True)
    assert all(low < value < high for value, [(low, high)] in known)


@pytest.mark.parametrize("kind", PLANTS[:3])
def test_sixteen_hundred_samples_of_steps_determine_a_resonance(kind: str) -> None:
    model = identify(made(kind, "steps", MODE, size=1600))
    assert model.dynamics.frequencies_Hz[0] == pytest.approx(500.0, rel=2e-3)
    assert model.report["fit"]["max_percent"] < 1.0


def test_a_resonance_that_tones_excite_faintly_all_the_time_is_in_the_model() -> None:
    assert_mode(
        identify(made("relay_preisach", "tones", ((300.0, 0.18, 1.0),), 0.95, size=4500)).dynamics,
        300.0,
        0.03,
        0.18,
        0.2,
    )


@pytest.mark.sample(1)
@pytest.mark.parametrize("drive", ["triangle", "sweep"])
def test_a_stage_of_the_given_structure_has_its_frequency_damping_and_delay_and_less_noise_gives_narrower_intervals(
    drive: str,
) -> None:
    s = ModelStructure.equidistant(5, 3, (0.0, 150.0), (-20.0, 20.0), (100.0, 10.0, 1.0), T, offset=True)
    x = DRIVES[drive](SIZE, 5)
    y = plants.get("dense_prandtl_ishlinskii", sample_time=T, creep_share=0.0).run(x)
    truth = identify(x, y, s, dynamics="ignore", lag="ignore", force=True)
    y, noise = through_modes(truth.simulate(x, truth.start), MODE, DELAY_S), np.random.default_rng(6).normal(size=SIZE)
    models = [identify(x, y + um * noise, s) for um in (0.2, 0.02)]
    noisy, clean = (np.ptp([*model.report["dynamics"]["intervals"].values()], axis=-1) for model in models)
    assert np.all(noisy[1:] > 1.2 * clean[1:])  # of damping and delay; nothing in the stage is unknown but the noise
    assert_mode(models[1].dynamics, 500.0, 5e-4, 0.01, 0.02)
    assert models[1].dynamics.delay_s == pytest.approx(DELAY_S, abs=0.05 * T)


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", [3, 15])
def test_a_ringing_stage_has_the_creep_that_it_would_have_without_ringing(seed: int) -> None:
    x = steps(SIZE, seed)
    behind, plain = (
        identify(Recording.from_arrays(x, recorded("relay_preisach", x, *ringing, 0.02, seed), T))
        for ringing in ((MODE, DELAY_S), ((), 0.0))
    )
    assert behind.structure.creep_rates == plain.structure.creep_rates != ()
    assert behind.report["creep"]["share"] == pytest.approx(plain.report["creep"]["share"], abs=0.05)


@pytest.mark.sample(5)
@pytest.mark.parametrize(
    ("kind", "drive", "modes_of_stage", "tolerances", "delay"),
    [
        ("maxwell_slip", "steps", MODE, (1e-3, 0.03, 1e-9), 0.05),
        ("maxwell_slip", "steps", ((300.0, 0.01, 0.8), (900.0, 0.02, 0.2)), (2e-3, 0.1, 0.05), 0.1),
        ("relay_preisach", "steps", ((300.0, 0.01, 0.8), (900.0, 0.02, 0.15)), (0.05, 0.05, 0.05), 0.5),
        *(
            ("maxwell_slip", drive, ((180.0, damping, 1.0),), (0.03, 0.05, 1e-9), 0.5)
            for drive in ("steps", "sweep")
            for damping in (0.3, 0.7)
        ),
        ("relay_preisach", "steps", ((120.0, 0.05, 0.9),), (0.05, 0.05, 0.05), 0.5),
    ],
)
def test_steps_and_sweeps_determine_weak_and_strong_modes_the_residual_compliance_and_the_delay(
    kind: str, drive: str, modes_of_stage: Modes, tolerances: tuple[float, ...], delay: float
) -> None:
    model = identify(made(kind, drive, modes_of_stage), n=5, m=3)
    found, true = np.array(modes(model.dynamics)), np.array(modes_of_stage)
    assert found.shape == true.shape
    assert np.all(np.abs(found - true) <= np.array(tolerances) * true)
    assert model.dynamics.delay_s == pytest.approx(DELAY_S, abs=delay * T)
    assert model.report["fit"]["rms_percent"] < 0.3


def test_a_mode_behind_a_delay_that_looks_like_residual_compliance_is_found() -> None:
    model = identify(made("relay_preisach", "steps", ((3e3, 0.01, 1.0),), seed=32, size=SIZE // 2), n=5, m=3)
    assert_mode(model.dynamics, 3000.0, 1e-3, 0.01, 0.1)


@pytest.mark.sample(6)
@pytest.mark.parametrize(
    ("kind", "drive", "noise_um"),  # every pair of two of them
    [(kind, drive, (0.002, 0.02, 0.2)[(i + j) % 3]) for i, kind in enumerate(PLANTS) for j, drive in enumerate(DRIVES)],
)
def test_no_resonance_is_found_where_there_is_none(kind: str, drive: str, noise_um: float) -> None:
    model = identify(made(kind, drive, (), noise_um, size=SIZE // 2), n=5, m=3, force=True)
    assert model.dynamics is None or not model.dynamics.frequencies_Hz
    assert "resonance" not in " ".join(model.report["sentences"])


@pytest.mark.parametrize(("kind", "samples"), [("duhem", 4.162), ("relay_preisach", 3.233), ("bouc_wen", 3.774)])
def test_a_sine_of_few_samples_a_period_has_a_model_for_slow_sines_without_a_resonance(
    kind: str, samples: float
) -> None:
    def sine(period: float) -> Recording:
        x = 75.0 + 75.0 * np.sin(2.0 * np.pi / period * np.arange(3000))
        y = plants.get(kind, sample_time=1e-3, creep_share=0.0).run(x)
        return Recording.from_arrays(x, y + 0.04 * np.random.default_rng(0).normal(size=x.size), 1e-3)

    model = identify(sine(samples))
    assert model.dynamics is None
    assert model.validate(sine(200.0)).fit.rms_percent < 1.0


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", [21, 22, 7, 27])
def test_a_backlash_whose_corners_look_like_a_resonance_has_a_model_without_one(seed: int) -> None:
    rng, k = np.random.default_rng(seed), np.arange(2000)
    turns = k * rng.uniform(2.0, 20.0) / k.size
    u = 0.5 - 0.5 * np.cos(2.0 * np.pi * turns) if seed % 2 else np.abs(2.0 * (turns % 1.0) - 1.0)
    y = play(u, np.array([rng.uniform(0.05, 0.3)]), u[:1])[0][:, 0] + 0.02 * u
    y = y - 0.3 * (y - 0.5) ** 3 * (seed % 3 == 0) + 1e-5 * rng.normal(size=k.size)
    dynamics = identify(Recording.from_arrays(100.0 * u, y, 1e-3)).dynamics
    assert dynamics is None or not dynamics.frequencies_Hz


def test_where_one_mode_gains_nothing_over_none_no_richer_dynamics_are_tried() -> None:
    x = steps(SIZE, 4, 0.02, 1e-3)
    recording = Recording.from_arrays(x, recorded("bouc_wen", x, (), 0.0, 0.02, 4, 1e-3), 1e-3)
    assert Spectra(recording).peak().gain > GAIN  # the scan alone would take it for a mode
    model, ignored = (identify(recording, n=5, m=3, dynamics=choice) for choice in ("estimate", "ignore"))
    assert model.dynamics is model.report["dynamics"] is None
    assert model.report["passes"] < 4 * ignored.report["passes"]


def moving(hardening: float, kind: str = "maxwell_slip", *, with_position: bool = False) -> Recording:
    x = steps(16_000, 8)
    y = on_a_spring(plants.get(kind, sample_time=T).run(x), 500.0, 0.01, hardening, with_position=with_position)
    return Recording.from_arrays(x, y + 0.02 * np.random.default_rng(9).standard_normal(y.size), T)


def test_a_model_that_is_forced_has_the_mean_resonance_and_a_warning_that_it_moves() -> None:
    model = identify(moving(0.05), n=5, m=3, force=True)
    assert model.warning.startswith("The model was forced although the resonance moves from ")
    low, high = model.report["dynamics"]["moves_Hz"][0]
    assert low < model.dynamics.frequencies_Hz[0] < high
    assert not any("faint" in sentence for sentence in model.report["sentences"])


def test_a_resonance_that_hardly_moves_is_kept_and_said_to_and_one_that_does_not_is_not() -> None:
    hardly, still = (identify(moving(hardening), n=5, m=3) for hardening in (0.005, 0.0))
    assert "It moves from 50" in " ".join(hardly.report["findings"])
    low, high = hardly.report["dynamics"]["intervals"]["frequencies_Hz"][0]
    assert low < 500.0 < high  # that of small vibrations, though the mean over the recording is known far better
    assert "moves" not in " ".join(still.report["sentences"])
    assert still.dynamics.frequencies_Hz[0] == pytest.approx(500.0, rel=1e-3)


def with_three_modes(drive: str, gains: tuple[float, float, float], noise_um: float) -> Recording:
    return made(
        "maxwell_slip", drive, tuple(zip((180.0, 430.0, 800.0), (0.01, 0.01, 0.02), gains, strict=True)), noise_um
    )


MOVES = r"the resonance moves from \d+\.?\d* to \d+\.?\d* Hz with the ampl"
A_THIRD = r"the output also rings near (43.|80.) Hz, by [01][.]\d+ % of"


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    ("record", "sentence"),
    [
        (partial(moving, -0.05, "maxwell_slip"), MOVES),
        (partial(moving, 0.05, "maxwell_slip", with_position=True), MOVES),
        (partial(with_three_modes, "steps", (0.6, 0.25, 0.15), 0.02), A_THIRD),
        (partial(with_three_modes, "binary", (0.5, 0.25, 0.25), 0.02), A_THIRD),
        (partial(moving, 0.05, "maxwell_slip"), MOVES),
        (partial(moving, -0.05, "duhem"), MOVES),
        (partial(moving, 0.05, "duhem", with_position=True), MOVES),
        (partial(moving, 0.05, "duhem"), MOVES),
    ],
    ids=[
        "softer with amplitude",
        "harder with position",
        "a third in steps",
        "a third in bits",
        "harder with amplitude",
        "Duhem, softer",
        "Duhem, with position",
        "Duhem, harder",
    ],
)
def test_a_resonance_that_moves_with_amplitude_or_position_and_a_third_one_are_refused_with_their_frequencies(
    record: Callable[[], Recording], sentence: str
) -> None:
    with pytest.raises(IdentificationError, match=sentence):
        identify(record(), n=5, m=3)


def test_a_third_resonance_that_rings_little_is_said_to_be_left_out() -> None:
    model = identify(with_three_modes("binary", (0.7, 0.24, 0.06), 0.002), n=5, m=3)
    assert len(model.dynamics.frequencies_Hz) == 2
    assert any(re.match("The output also rings near 80. Hz", sentence) for sentence in model.report["sentences"])


def test_all_findings_about_a_stage_that_falls_and_rings_twice_are_said_first() -> None:
    rising = made("maxwell_slip", "steps", ((120.0, 0.03, 0.8), (900.0, 0.01, 0.2)))
    findings = identify(replace(rising, y=-rising.y), n=5, m=3).report["findings"]
    begins = (
        "The output falls",
        "The stage has a resonance at 120.",
        "The stage has a resonance at ",
        "The output is delayed by ",
    )
    assert all(finding.startswith(begin) for finding, begin in zip(findings, begins, strict=True))


def test_figures_have_no_intervals_where_the_model_leaves_a_ringing_that_hardly_dies_away() -> None:
    report = identify(made("relay_preisach", "sweep", ((827.4, 0.0059, 1.0),), size=2 * SIZE)).report
    assert report["intervals"] is None
    assert "intervals for these orders" not in " ".join(report["sentences"])
    assert "A faint resonance near 828 Hz" in " ".join(report["sentences"])


def test_a_faint_resonance_is_named_with_what_to_record() -> None:
    model = identify(made("relay_preisach", "triangle", ((300.0, 0.1, 1.0),), 0.05, size=SIZE // 4), force=True)
    assert model.dynamics.frequencies_Hz == ()  # a delay stands for it
    assert any("record steps of 20 ms to determine it" in sentence for sentence in model.report["findings"])


def test_known_dynamics_that_are_worse_than_a_line_are_refused() -> None:
    x = 75.0 + 75.0 * np.sin(2.0 * np.pi / 4.162 * np.arange(3000))
    fast = Recording.from_arrays(x, plants.get("duhem", sample_time=1e-3, creep_share=0.0).run(x), 1e-3)
    with pytest.raises(IdentificationError, match="this model is no better"):
        identify(fast, dynamics=Dynamics((144.0,), (0.012,), (1.0,), 8e-4))


def test_known_dynamics_stay_as_they_are() -> None:
    recording, known = made("maxwell_slip", "steps", MODE), Dynamics((501.0,), (0.011,), (1.0,), 1.3 * T)
    model = identify(recording, n=5, m=3, dynamics=known)
    assert (model.dynamics, model.report["lag"]) == (known, None)
