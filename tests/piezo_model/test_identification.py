"""Identification of models that are in the class, of the real recording, with lags and with missing outputs."""

from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from known_models import a_drive, structure, true_model
from programs import real_recording
from scipy.signal import chirp, lfilter, sawtooth

from piezo_model import HysteresisCreepModel, Recording, identify, plants
from piezo_model.identification import dynamics
from piezo_model.operator_state import OperatorState, padded_thresholds


def sentences(model: HysteresisCreepModel, words: str) -> list[str]:
    return [sentence for sentence in model.report["sentences"] if words in sentence]


# Models that are in the class.


def test_the_default_solver_and_another_one_give_the_same_model() -> None:
    s, x = structure(), a_drive(3000)
    y = true_model(s).simulate(x) + 0.1 * np.random.default_rng(0).normal(size=x.size)
    own, other = identify(x, y, s), identify(x, y, s, solver="daqp")
    np.testing.assert_allclose(own.weights, other.weights, rtol=0, atol=1e-9)


def test_an_unknown_start_is_found_and_every_sample_counts() -> None:
    s, x = structure(), a_drive()
    descended = 0.4 + 0.7 * padded_thresholds(s)  # from somewhere: no one knows
    start = OperatorState(descended, np.tile(descended, len(s.creep_rates)))
    model = identify(x, true_model(s).simulate(x, start), s)
    assert model.report["fit"]["skipped"] == 0
    assert model.report["fit"]["max_percent"] < 0.5


@pytest.mark.parametrize("rest", [0.0, 0.9, -0.9])
def test_the_weight_of_a_threshold_beyond_the_drive_keeps_its_reference_and_a_curve_beyond_it_goes_on(
    rest: float,
) -> None:
    s, x = structure(creep_rates=(0.1,)), 50 + 0.6 * (a_drive() - 50)
    model = identify(x, true_model(s).simulate(x, OperatorState.settled_at(s, s.x_centre + rest * s.x_scale)), s)
    assert s.play_thresholds[-1] * s.x_scale > np.ptp(x) / 2 > s.play_thresholds[-2] * s.x_scale
    assert model.report["fit"]["skipped"] == 0
    assert "w_H3" in model.report["excitation"]["unreached"]
    assert model.weights[2] == 0.0
    assert sentences(model, "The drive never reached the thresholds of w_H3")
    assert rest != 0.9 or model.weights[s.slices[1]][0] == pytest.approx(0.0, abs=1e-12)  # of an output never below


@pytest.mark.sample(1)
@pytest.mark.parametrize("noise", [0.05, 0.01])
def test_noise_of_the_sensor_biases_the_papers_weights_and_not_those_of_the_smallest_output_error(noise: float) -> None:
    s, x = structure(creep_rates=()), a_drive(20_000)
    true = true_model(s).simulate(x, OperatorState.settled_at(s, x[0]))
    y = true + noise * np.ptp(true) * np.random.default_rng(0).normal(size=x.size)
    models = [identify(x, y, s, estimator=estimator, lag="ignore") for estimator in ("forward", "error-model")]
    forward, biased = (100 * np.std(model.simulate(x) - true) / np.ptp(true) for model in models)
    assert forward < min(5.0 * noise, 0.5 * biased)
    assert all(model.report["hysteresis"] for model in models)


def test_the_offset_is_identified_and_reported() -> None:
    s, x = structure(creep_rates=()), a_drive()
    model = identify(x, replace(true_model(s), offset=0.25).simulate(x), s)
    assert model.offset == pytest.approx(0.25, abs=1e-5)
    assert model.report["figures"]["offset"] == pytest.approx(0.25 * s.x_scale, abs=1e-3)
    assert sentences(model, ", offset 12.5 (")


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    ("choice", "tenths"),
    [
        *(("estimate", 30), ("estimate", 7), ("remove", 24)),
        *(("estimate", 10), ("estimate", 24), ("remove", 7), ("remove", 10), ("remove", 30)),
    ],
)
def test_a_whole_and_a_fractional_lag_are_identified_and_reported(choice: str, tenths: int) -> None:
    fine, size = 10, 4000
    s, fine_s = structure(creep_rates=()), structure(creep_rates=(), sample_time=5e-4)
    x = a_drive(size, fine)
    y = np.roll(true_model(fine_s).simulate(x, OperatorState.settled_at(s, s.x_centre + 0.2 * s.x_scale)), tenths)
    recording = Recording.from_arrays(x[fine * 20 :: fine], y[fine * 20 :: fine], 5e-3)
    model, with_lag = (identify(recording, structure=s, lag=each) for each in (choice, "ignore"))
    found = model.report["lag"]
    assert found["samples"] == pytest.approx(tenths / fine, abs=0.03)
    assert found["error_percent"] < 0.2 * found["error_without_lag_percent"]
    (sentence,) = sentences(model, f"{found['samples']:.2f} samples")
    assert {found["removed"], "attributed to the sensor" in sentence, model.dynamics is None} == {choice == "remove"}
    assert model.report["fit"]["skipped"] == 0
    assert model.report["fit"]["rms_percent"] < 0.3 * with_lag.report["fit"]["rms_percent"]
    assert model.validate(recording).fit.rms == pytest.approx(model.report["fit"]["rms"], rel=0.1)


def test_removal_of_a_lag_keeps_the_known_states_at_the_start() -> None:
    fine, t = 10, np.arange(0, 2000, 0.1)
    s, fine_s = structure(creep_rates=()), structure(creep_rates=(), sample_time=5e-4)
    # one large swing, then growing ones
    x = 50 + 45 * np.sin(t / 12) * np.where(t < 12 * np.pi, 1.0, 0.1 + 0.9 * t / 2000)
    state = OperatorState.settled_at(s, s.x_centre)
    y = np.roll(true_model(fine_s).simulate(x, state), 24)
    y[:24] = y[24]
    model = identify(x[::fine], y[::fine], s, lag="remove", state=state)
    assert (model.report["lag"]["samples"], model.report["fit"]["skipped"]) == (pytest.approx(2.4, abs=0.03), 0)
    assert model.report["fit"]["rms_percent"] < 0.02


def test_a_lag_beyond_the_longest_tried_one_is_reported_as_a_lower_bound() -> None:
    # refused as a delay otherwise
    assert sentences(
        identify(lagging(40), n=2, m=1, creep_rates=(), force=True), "lags by 20.00 samples or more, the search limit"
    )


def test_a_lag_is_identified_after_a_rest_longer_than_the_samples_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dynamics, "SAMPLES", 3000)
    s, x = structure(creep_rates=()), np.concatenate([np.full(3500, 50.0), a_drive(3000)])
    state = OperatorState.settled_at(s, 50.0)
    model = identify(x[4:], true_model(s).simulate(x, state.copy())[:-4], s, state=state, skip=100, force=True)
    assert model.report["lag"]["samples"] == pytest.approx(4.0, abs=0.03)


@pytest.mark.sample(6)
@pytest.mark.parametrize("moving", [1, 31, 5])
@pytest.mark.parametrize("at_the_end", [True, False])
@pytest.mark.parametrize("force", [True, False])
def test_a_drive_that_moves_at_one_end_alone_gives_a_model_without_a_lag(
    moving: int, at_the_end: bool, force: bool
) -> None:
    s, x = structure(creep_rates=()), np.r_[np.linspace(100.0, 50.0, moving), np.zeros(3000 - moving)]
    x = x[::-1].copy() if at_the_end else x
    y = true_model(s).simulate(x) + 0.001 * np.random.default_rng(0).standard_normal(x.size)
    report = identify(x, y, s, force=force).report
    known = (pytest.approx(0.0, abs=0.01), False) if at_the_end or moving == 31 else None  # no counted sample moves
    assert (report["lag"] and (report["lag"]["samples"], report["lag"]["is_significant"])) == known
    assert report["fit"]["max_percent"] < 5.0


# The real recording.


def errors_percent(y: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """The RMS and the largest error in per cent of the range."""
    return 100 * np.array([np.sqrt(np.mean((y - expected) ** 2)), np.max(np.abs(y - expected))]) / np.ptp(expected)


def test_the_real_recording_is_fitted_and_its_transient_is_named(tmp_path: Path) -> None:
    recording = Recording.open(real_recording())
    model = identify(recording, n=5, m=3, creep_rates=(10.0, 1.0, 0.1))
    fit = model.report["fit"]
    assert fit["rms_percent"] <= 0.289
    assert fit["max_percent"] <= 1.03
    assert 0.1 < fit["skipped"] * recording.sample_time < 0.5
    assert len(sentences(model, "as a switch-on transient")) == 1
    # The error of the output hardly depends on the lag; that of (5), which noise biases, is smallest at 3.57 samples.
    lag = model.report["lag"]
    assert lag["samples"] < 2.0
    assert lag["error_percent"] > 0.98 * lag["error_without_lag_percent"]
    model.save(tmp_path / "stage.json")
    simulated = HysteresisCreepModel.load(tmp_path / "stage.json").simulate(recording.x)
    found = errors_percent(simulated[fit["skipped"] :], recording.counted_y[fit["skipped"] :])
    np.testing.assert_allclose(found, (fit["rms_percent"], fit["max_percent"]), rtol=1e-9)


def test_a_model_of_the_first_half_of_the_real_recording_predicts_the_second() -> None:
    whole = Recording.open(real_recording())
    x, y = whole.x, whole.counted_y
    half = whole.length // 2
    first = Recording.from_arrays(x[:half], y[:half], whole.sample_time, name="first half")
    model = identify(first, n=5, m=3, creep_rates=(10.0, 1.0, 0.1))
    errors, fit = errors_percent(model.simulate(x)[half:], y[half:]), model.report["fit"]
    assert np.all(errors < 1.2 * np.array([fit["rms_percent"], fit["max_percent"]]))  # RMS 0.300 % after 0.293 %
    assert model.dynamics == identify(replace(first, x=first.x * (1.0 + 1e-14)), n=5, m=3).dynamics


# Missing outputs.


@pytest.mark.sample(5)
@pytest.mark.parametrize(
    "missing", [[0, 1, 2], [700, 1900, 1901], range(1000, 1200), range(2800, 3000), range(0, 3000, 3)]
)
@pytest.mark.parametrize("lag", ["estimate", "remove"])
def test_missing_outputs_are_left_out_of_the_fit_and_counted_in_the_sentence(
    missing: list[int] | range, lag: str
) -> None:
    s, x = structure(creep_rates=(1.0,)), a_drive(3000)
    start = OperatorState.settled_at(s, x[0])
    y = true_model(s).simulate(x, start) + 0.02 * np.random.default_rng(0).normal(size=x.size)
    whole = identify(x, y, s, lag=lag)
    y[[*missing]] = np.nan
    gaps = Recording.from_arrays(x, y, s.sample_time)
    assert f"; {len(missing)} of them not counted" in gaps.describe()
    model = identify(gaps, structure=s, lag=lag)
    fit, of_all, found = model.report["fit"], whole.report["fit"], model.validate(gaps)
    assert (fit["samples"] + fit["missing"], fit["missing"]) == (of_all["samples"] + of_all["missing"], len(missing))
    assert f"samples ({fit['missing']} not counted);" in model.report["headline"]
    assert ("not counted" in next(found.sentences())) == (found.fit.missing > 0)
    assert [fit["rms"], found.fit.rms] == pytest.approx([of_all["rms"], fit["rms"]], rel=0.05)
    assert np.abs(model.simulate(x) - whole.simulate(x)).max() < 0.05


def lagging(lag: float) -> Recording:
    """A signal that is known between the samples, too, with thirty samples a period or more, and the same later."""
    x, y = (
        20 * np.sin(0.03 * k) + 3 * np.cos(0.1 * k + 1) + 0.5 * np.sin(0.2 * k) - 96
        for k in (np.arange(6000), np.arange(6000) - lag)
    )
    return Recording.from_arrays(x, 2 * y, 1e-3)


@pytest.mark.sample(2)
@pytest.mark.parametrize("lag", [0.4, 6.0, 2.3])
def test_a_lag_of_the_sensor_is_found_to_a_hundredth_of_a_sample(lag: float) -> None:
    found = identify(lagging(lag), n=2, m=1, creep_rates=(), force=True).report["lag"]
    assert found["samples"] == pytest.approx(lag, abs=0.01)
    assert (
        found["error_percent"] < 0.1 * found["error_without_lag_percent"]
    )  # the samples before the first one are unknown


T = np.arange(6000) * 1e-3
TRIANGLE = 75.0 * (1.0 + sawtooth(2 * np.pi * T, 0.5))
DRIVES = {
    "tones": 75.0 + 25.0 * sum(np.sin(2 * np.pi * f * T + f) for f in (0.7, 1.9, 4.3)),
    "triangle": TRIANGLE,
    "shrinking triangle": TRIANGLE * (1.0 - 0.15 * T),
}


def of_a_stage(name: str, x: np.ndarray, lag: float = 0.0) -> Recording:
    """A recording of a stage whose sensor lags by some samples."""
    y = np.interp(np.arange(x.size) - lag, np.arange(x.size), plants.get(name, sample_time=1e-3).run(x))
    return Recording.from_arrays(x, y + np.random.default_rng(4).normal(0.0, 0.02, x.size), 1e-3)


@cache
def model_of(name: str, drive: str, lag: float = 0.0) -> HysteresisCreepModel:
    return identify(of_a_stage(name, DRIVES[drive], lag))


@pytest.mark.parametrize("name", ["relay_preisach", "maxwell_slip"])
@pytest.mark.parametrize("drive", ["tones", "triangle"])
def test_a_stage_without_a_lag_is_not_said_to_have_one(name: str, drive: str) -> None:
    report = model_of(name, drive).report
    said = " ".join(report["findings"])
    assert (report["lag"]["is_significant"], "lags by" in said, "--lag" in said) == (False, False, False)


@pytest.mark.parametrize("drive", DRIVES)
def test_a_drive_that_turns_at_the_ends_of_its_range_alone_is_said_to_tell_little_of_inner_loops(drive: str) -> None:
    assert (drive == "triangle") == bool(
        sentences(
            model_of("relay_preisach", drive),
            "reverses only at the ends of its range, and says little about inner loops",
        )
    )


@pytest.mark.sample(1)
@pytest.mark.parametrize("lag", [1.0, 3.0])
def test_a_lag_in_noise_is_named_with_errors_that_are_shares_of_the_full_range(lag: float) -> None:
    report = model_of("maxwell_slip", "tones", lag).report
    assert report["lag"]["is_significant"]
    assert report["lag"]["samples"] == pytest.approx(lag, abs=0.3)  # creep lags, too
    assert report["lag"]["error_percent"] < report["fit"]["rms_percent"] < report["lag"]["error_without_lag_percent"]


@pytest.mark.parametrize("lag", [0.0, 1.0])
def test_a_lag_that_a_triangle_does_not_tell_from_hysteresis_is_said_to_be_possible(lag: float) -> None:
    model = model_of("relay_preisach", "triangle", lag)
    assert not model.report["lag"]["is_significant"]
    assert model.report["lag"]["at_most_s"] > 1e-3 * max(lag, 1.0)
    assert sentences(model, "no significant lag, but may lag by up to")


def amplified(x: np.ndarray, tau_s: float, sample_time: float) -> np.ndarray:
    """Four samples of an amplifier of first order for each that is held."""
    p = np.exp(-0.25 * sample_time / tau_s)
    return np.asarray(lfilter([1 - p], [1, -p], np.repeat(x - x[0], 4)) + x[0])


@pytest.mark.sample(2)
@pytest.mark.parametrize(("tau_s", "delay_s"), [(4e-3, 1e-3), (0.0, 2e-3), (4e-3, 0.0)])
def test_a_delay_and_the_lag_of_an_amplifier_without_a_mode_are_in_the_model(tau_s: float, delay_s: float) -> None:
    def made(seed: int, hold: int) -> Recording:
        rng = np.random.default_rng(seed)
        x = np.repeat(rng.uniform(0.0, 150.0, 6000 // hold), hold)
        y = plants.get("maxwell_slip", sample_time=2.5e-4).run(amplified(x, tau_s, 1e-3) if tau_s else np.repeat(x, 4))
        late = round(delay_s / 1e-3)
        y = np.concatenate([np.full(late, y[3]), y[3::4][: x.size - late]])
        return Recording.from_arrays(x, y + rng.normal(0.0, 0.01, x.size), 1e-3)

    model = identify(made(1, 40))
    found, tau = model.dynamics, pytest.approx(tau_s, rel=0.03)
    assert (found.frequencies_Hz, found.delay_s, found.amplifier_lag_s) == ((), pytest.approx(delay_s, abs=1e-4), tau)
    assert model.validate(made(2, 15)).fit.rms < 3.0 * model.report["fit"]["rms"]
    assert sentences(model, "; the model includes the lag")


def test_a_chirp_tells_the_lag_of_an_amplifier_from_a_delay_beside_many_plays() -> None:
    period, tau_s = 1e-4, 1.5e-4
    t = np.arange(20_000) * period
    x = 75.0 - 75.0 * np.exp(-t / 2.0) * chirp(t, 1.0, 2.0, 1200.0)
    y = plants.get("maxwell_slip", sample_time=period / 4.0).run(amplified(x, tau_s, period))[3::4]
    model = identify(Recording.from_arrays(x, y + np.random.default_rng(5).normal(0.0, 0.02, x.size), period))
    assert model.dynamics.amplifier_lag_s == pytest.approx(tau_s, rel=0.03)
    assert model.dynamics.delay_s == pytest.approx(0.0, abs=0.05 * period)
    # without creep, which a chirp of two seconds does not tell from hysteresis
    assert model.report["fit"]["rms"] < 0.07


LEVELS = {
    "two levels": np.repeat(np.random.default_rng(0).integers(0, 2, 200), 40),
    "three levels": np.repeat(np.random.default_rng(0).integers(0, 3, 200), 40),
    "a pulse": np.arange(1000) == 500,
}


@pytest.mark.sample(2)
@pytest.mark.parametrize("drive", LEVELS)
def test_few_levels_are_said_not_to_determine_hysteresis_and_bound_the_orders_that_no_rounding_error_chooses(
    drive: str,
) -> None:
    x, levels, factors = 100.0 * LEVELS[drive], np.unique(LEVELS[drive]).size, (1.0 - 1e-14, 1.0 + 1e-14, 1.0)
    y = of_a_stage("maxwell_slip", x).y
    model, *others = (
        identify(Recording.from_arrays(x, factor * y, 1e-3), force=drive != "a pulse") for factor in factors
    )
    assert {other.structure.d for other in others} == {model.structure.d}
    assert model.structure.n < levels >= model.structure.dead_zones
    assert sentences(
        model, f"The drive has {levels} levels and hardly any samples between them, where the model is a guess"
    )
    assert not model.report["drive"]["hysteresis"]
    assert not sentences(model, "No hysteresis") + sentences(model, "a single branch")


def model_of_saturating(name: str, bend: float, u: np.ndarray) -> HysteresisCreepModel:
    v = plants.get(name, sample_time=1e-3, x_range=(-1.0, 1.0), y_range=(-1.0, 1.0)).run(u)
    noise = np.random.default_rng(0).normal(0.0, 0.02, u.size)
    return identify(Recording.from_arrays(u, np.tanh(bend * v) + noise, 1e-3))


@pytest.mark.parametrize(
    "identified",
    [
        partial(
            model_of_saturating,
            "dense_prandtl_ishlinskii",
            3.0,
            np.interp(np.arange(1000), [0, 50, 250, 500, 700, 1000], [-1, -1, 1, 1, -1, -1]),
        ),
        partial(model_of_saturating, "maxwell_slip", 2.0, np.repeat(sawtooth(np.pi / 6.0 * np.arange(19), 0.5), 100)),
        partial(model_of, "maxwell_slip", "tones", 1.0),
        partial(model_of, "maxwell_slip", "tones", 3.0),
    ],
    ids=["ends", "stairs", "a lag of one sample", "a lag of three samples"],
)
def test_the_chosen_orders_have_nearly_the_predicted_error_also_in_a_stage_that_saturates_at_its_ends(
    identified: partial[HysteresisCreepModel],
) -> None:
    report = identified().report
    assert [row["error_percent"] for row in report["selection"]["table"] if row["standing"]] == [
        pytest.approx(report["fit"]["rms_percent"], rel=0.1)
    ]


def test_rounding_errors_choose_no_orders_of_an_exact_line() -> None:
    x, factors = DRIVES["tones"][:2000], (1.0, 1.0 - 1e-14, 1.0 + 1e-14)
    models = [identify(Recording.from_arrays(x, factor * (0.3 * x + 3.0), 1e-3)) for factor in factors]
    assert {(model.structure.n, model.structure.dead_zones) for model in models} == {(1, 1)}
