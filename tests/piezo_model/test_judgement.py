"""Recordings that give a model and recordings that are refused, independent of units, signs and offsets."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import ALL
from recording_kinds import (
    DESCRIBABLE,
    SAMPLE_TIME,
    UNDESCRIBABLE,
    Vector,
    creeping,
    drive,
    loops,
    noisy,
    recording,
    resonant,
)

from bench.report.fit_review import review
from piezo_model import HysteresisCreepModel, IdentificationError, Recording, identify
from piezo_model.identification.start import structure_of
from piezo_model.operators import play
from piezo_model.recordings import RecordingError
from piezo_model.units import UnitError, quantity


@cache
def known() -> tuple[Recording, HysteresisCreepModel]:
    """A recording and its model, of three plays and one dead zone on each side."""
    made = recording(DESCRIBABLE["hysteresis and creep"], 3)
    return made, identify(made, structure=structure_of(made, 3, 1))


def driven(u: Vector, form: Callable[..., Vector] = loops, seed: int = 0, noise: float = 0.001) -> Recording:
    """A drive, and what hysteresis of a form makes of it."""
    rng = np.random.default_rng(seed)
    return Recording.from_arrays(u, noisy(rng, form(rng, u), noise), SAMPLE_TIME, output_unit="um")


SEED, SEEDS = 11, st.integers(0, 10_000)


@pytest.mark.sample(4)
@pytest.mark.parametrize("kind", UNDESCRIBABLE)
def test_data_outside_the_model_class_are_refused_with_the_reason(kind: str) -> None:
    made, reason = UNDESCRIBABLE[kind]
    with pytest.raises((IdentificationError, RecordingError)) as caught:
        identify(recording(made, SEED))
    reasons = {*(each for _, each in UNDESCRIBABLE.values()), "butterfly"}
    assert {each for each in reasons if each in str(caught.value)} == {reason}
    assert "\n" not in str(caught.value)


@pytest.mark.sample(6)
@pytest.mark.parametrize("kind", DESCRIBABLE)
def test_data_in_the_model_class_are_accepted(kind: str) -> None:
    model = identify(recording(DESCRIBABLE[kind], SEED))
    fit, findings = model.report["fit"], " ".join(model.report["findings"])
    assert fit["rms_percent"] <= fit["line_percent"] * (1.0 + 1e-9) or fit["rms_percent"] < 1e-4
    assert ("No hysteresis" in findings) == (
        kind in ("saturation without hysteresis", "a straight line", "a straight line of a coarse sensor")
    )
    assert ("falls as the input rises" in findings) == (kind == "a falling output")
    assert model.figures()["hysteresis_percent"][1] == 0.0 or kind != "a straight line in noise"


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", [5, 7, 8, 19])
def test_a_slow_drive_whose_first_samples_are_a_short_arc_is_judged_by_all_samples(seed: int) -> None:
    slow = recording(DESCRIBABLE["a slow sine and a lag"], seed)
    assert identify(slow, n=3, m=1).report["fit"]["samples"] > 50_000


def test_a_model_that_is_hardly_better_than_a_line_is_refused_with_the_reason_and_forced_says_it_first() -> None:
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 1.0, 50), 200)
    made = Recording.from_arrays(u, noisy(rng, resonant(loops(rng, u, 0.2), 300.0, 0.7, 1e-4), 5e-4), 1e-4)
    with pytest.raises(IdentificationError, match=r"RMS residual .* of range with a straight line, "):
        identify(made, dynamics="ignore")
    report = identify(made, dynamics="ignore", force=True).report
    assert report["fit"]["rms_percent"] > 0.7 * report["fit"]["line_percent"]
    first, *others = report["findings"]
    assert first.startswith("The model was forced although the model class does not describe these data")
    assert len(others) < 4


@pytest.mark.parametrize("curve", [lambda u: u**2 + u, lambda u: np.exp(2.0 * u), lambda u: np.tanh(1.5 * u)])
@pytest.mark.sample(4)
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_bent_curve_without_hysteresis_is_accepted_with_a_remark(curve: Callable, noise: float) -> None:
    u = 0.1 + np.concatenate([np.linspace(-0.5, 0.9, 1000), np.linspace(0.9, -0.5, 1000)])
    report = identify(driven(u, lambda _, u: curve(u), noise=noise)).report
    assert report["refusal"] is None
    assert report["intervals"]["figures"]["hysteresis_percent"][0] < 1e-3
    assert any(finding.startswith("No hysteresis: ") for finding in report["findings"])


@pytest.mark.parametrize(("seed", "noise"), [(0, 0.05), (1, 0.1)])
def test_loops_that_are_smaller_than_the_noise_of_the_sensor_give_a_model(seed: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    u = drive(rng, 20_000, form=3)
    clean = loops(rng, u, 0.25)
    model = identify(Recording.from_arrays(u, noisy(rng, clean, noise), SAMPLE_TIME))
    assert model.report["fit"]["rms_percent"] > 0.85 * model.report["fit"]["line_percent"]
    assert model.report["hysteresis"]
    assert np.std(model.simulate(u) - clean) < 0.01 * np.ptp(clean)


def test_a_sawtooth_shows_one_branch_of_the_loop_and_is_not_said_to_determine_hysteresis() -> None:
    report = identify(driven(np.resize(np.linspace(-1.0, 1.0, 300), 3000))).report
    assert "almost a single branch" in " ".join(report["findings"])
    assert not report["drive"]["hysteresis"]


def test_few_counted_samples_and_a_single_branch_are_reported() -> None:
    report = identify(driven(np.linspace(-1.0, 1.0, 3000), creeping), skip=2000).report
    findings = " ".join(report["findings"])
    assert "Only 1000 of 3000 samples are counted" in findings
    assert report["fit"]["skipped_max_percent"] < 10.0
    assert "almost a single branch" in findings
    assert "determines none of hysteresis, creep and drift" in report["drive"]["sentence"]
    assert not report["drive"]["hysteresis"]


# Only the data decide.


@settings(max_examples=8 if ALL else 2)
@given(
    seed=SEEDS,
    scale=st.sampled_from([-1.0, 1e-3, -7.3, 250.0]),
    offset=st.floats(-20, 20),
    x_scale=st.sampled_from([1.0, 1e3, 0.07]),
    x_offset=st.floats(-20, 20),
)
def test_sign_offset_and_unit_change_the_model_by_scale_alone(
    seed: int,
    scale: float,
    offset: float,
    x_scale: float,
    x_offset: float,
) -> None:
    rng = np.random.default_rng(seed)
    u = drive(rng, 3000)
    y = noisy(rng, creeping(rng, u))
    one = identify(Recording.from_arrays(u, y, SAMPLE_TIME), lag="ignore")
    other = identify(Recording.from_arrays(x_scale * u + x_offset, scale * y + offset, SAMPLE_TIME), lag="ignore")
    assert other.structure.negative_gain == (scale < 0.0)
    expected = scale * one.simulate(u, one.start) + offset
    np.testing.assert_allclose(
        other.simulate(x_scale * u + x_offset, other.start), expected, rtol=0, atol=1e-9 * np.ptp(scale * y)
    )
    np.testing.assert_allclose(other.report["fit"]["rms_percent"], one.report["fit"]["rms_percent"], rtol=1e-9)


# Of sixteen such recordings three fail if the model starts from its own initial state, offset included, instead of an
# estimate for the next loop: 2.2, 2.6 and 3.3 times the fit. A single loop hardly distinguishes creep as slow as itself
# from the offset and the level at which creep had rested. With creep rates of at least three over the length one of the
# sixteen fails (2.4 times), without creep none, but the fits of creeping actuators are 1.15 to 1.4 times as large; a
# long recording needs its slow rates, so the rates are unchanged.
@settings(max_examples=8 if ALL else 2)
@given(seed=SEEDS)
def test_one_loop_predicts_the_next_within_twice_the_fit_of_the_whole(seed: int) -> None:
    rng = np.random.default_rng(seed)
    period, cycles = int(rng.integers(400, 2500)), int(rng.integers(4, 8))
    u = np.sin(2 * np.pi * (np.arange(period * cycles) / period + rng.uniform()))
    form = [loops, creeping, lambda rng, u: np.tanh(loops(rng, u))][int(rng.integers(3))]
    y = noisy(rng, form(rng, u), 0.001)
    first = int(rng.integers(0, (cycles - 2) * period))
    whole, one, then = (
        Recording.from_arrays(u[part], y[part], SAMPLE_TIME)
        for part in (slice(None), slice(first, first + period), slice(first + period, first + 2 * period))
    )
    assert identify(one).validate(then).fit.rms_percent <= 2.0 * identify(whole).report["fit"]["rms_percent"]


# The model on the recording it comes from, and on others.


def test_a_rest_a_jump_and_an_offset_before_a_sine_do_not_change_the_fit() -> None:
    t = np.arange(12_000) * SAMPLE_TIME
    u = np.where(t < 3.0, 0.0, 150.0 * np.sin(2 * np.pi * 0.5 * (t - 3.0) - 0.62))
    assert u[3000] == pytest.approx(-87.0, abs=1.0)
    made = driven(u, lambda rng, u: 20.0 * loops(rng, u / 150.0) - 7.0, seed=8)
    whole, sine = (identify(each) for each in (made, Recording.from_arrays(u[3000:], made.y[3000:], SAMPLE_TIME)))
    assert whole.report["fit"]["skipped"] == 0
    assert whole.report["fit"]["rms"] == pytest.approx(sine.report["fit"]["rms"], rel=0.2)
    assert whole.report["fit"]["rms_percent"] < 0.3


def test_validation_finds_the_start_and_removes_the_offset_between_sessions() -> None:
    u = np.sin(np.arange(9000) / 200) * (0.6 + 0.4 * np.sin(np.arange(9000) / 1700))
    y = driven(u, seed=5).y
    model = identify(Recording.from_arrays(u[:4500], y[:4500], SAMPLE_TIME, output_unit="um"))
    found = model.validate(Recording.from_arrays(u[4700:], y[4700:] + 0.4, SAMPLE_TIME, output_unit="um"))
    assert found.shift == pytest.approx(0.4, abs=0.01)
    assert found.fit.rms_percent < 2.0 * model.report["fit"]["rms_percent"]
    said = rf"by a constant {quantity(found.shift, 'um', 3)} \(.*without it"
    assert any(re.search(said, sentence) for sentence in found.sentences())


def test_errors_on_another_recording_are_compared_in_units_and_not_as_shares_of_two_ranges() -> None:
    rng, u = np.random.default_rng(5), np.sin(np.arange(9000) / 200) * np.linspace(1.0, 0.2, 9000)
    y = noisy(rng, loops(rng, u, 0.2), 0.003)
    model = identify(Recording.from_arrays(u[:6000], y[:6000], SAMPLE_TIME), n=5, m=3, creep_rates=())
    small = slice(7500, None)
    found = model.validate(Recording.from_arrays(u[small], y[small], SAMPLE_TIME))
    assert found.fit.rms_percent > 2.0 * model.report["fit"]["rms_percent"]  # of a smaller range
    assert "times the" not in " ".join(found.sentences())
    y[small] += 0.02 * np.ptp(y) * rng.standard_normal(y[small].size)
    worse = model.validate(Recording.from_arrays(u[small], y[small], SAMPLE_TIME, output_unit="um"))
    assert "times that on the recording of the identification" in " ".join(worse.sentences())


def test_a_recording_in_units_of_something_else_than_the_models_is_refused() -> None:
    made, model = known()
    with pytest.raises(UnitError, match=r"the input is in nm, .* to V;"):
        model.validate(replace(made, input_unit="nm"))


def test_a_recording_at_another_rate_is_validated_and_simulated_by_the_model_at_that_rate() -> None:
    made, model = known()
    slow = Recording.from_arrays(made.x[::2], made.y[::2], 2.0 * SAMPLE_TIME)
    found = model.validate(slow)
    assert found.model.structure.sample_time == 2.0 * SAMPLE_TIME
    assert found.fit.rms_percent < 1.5 * model.validate(made).fit.rms_percent
    assert np.sqrt(np.mean((model.simulate(slow) - slow.y) ** 2)) < 1.5 * model.report["fit"]["rms"]


def test_a_recording_in_mV_and_nm_is_identified_validated_and_simulated_like_that_in_V_and_um() -> None:
    made, model = known()
    small = replace(made.in_units("mV", "nm"), name="small.csv", units="")
    said = "small.csv: the input is converted from mV to V and the output is converted from nm to µm."
    other = identify(small, structure=structure_of(made, 3, 1))
    np.testing.assert_allclose(other.weights, model.weights, rtol=1e-6, atol=1e-9)
    assert other.structure == model.structure
    found, expected = model.validate(small), model.validate(made)
    assert found.fit.rms == pytest.approx(expected.fit.rms, rel=1e-9)
    reports = (other.report["sentences"], model.report["sentences"], found.sentences(), expected.sentences())
    assert [said in sentences for sentences in reports] == [True, False, True, False]
    np.testing.assert_allclose(model.simulate(small), model.simulate(made), atol=1e-9 * np.ptp(made.y))
    np.testing.assert_allclose(review(small, model, found).y + found.shift, made.y, rtol=1e-12)


def test_a_recording_without_units_is_taken_in_those_of_the_model_with_a_sentence() -> None:
    made, model = known()
    found = model.validate(Recording.from_arrays(made.x, made.y, SAMPLE_TIME, name="bare.csv"))
    assert found.fit.rms == pytest.approx(model.report["fit"]["rms"], rel=1e-5)  # its mean error is 0 to first order
    assert (
        "bare.csv: the input is taken as it is, since only one unit is known (V) and the output is taken as it is, "
        "since only one unit is known (µm)."
    ) in found.sentences()


# A transient at the start.


def switched_on(period: float, size: float, length: int) -> Recording:
    """A stage whose recording begins with an amplifier's transient of ``size`` times the range."""
    rng, k = np.random.default_rng(4), np.arange(3000)
    u = np.sin(2 * np.pi * k / period) * (0.7 + 0.3 * np.sin(2 * np.pi * k / 700))
    y = noisy(rng, loops(rng, u, 0.2), 0.001)
    y[:length] += size * np.ptp(y) * np.exp(-4.0 * k[:length] / length)
    return Recording.from_arrays(
        75.0 + 70.0 * u, 3.0 + 8.0 * y, SAMPLE_TIME, input_unit="V", output_unit="um", name="stage"
    )


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    ("period", "size", "length", "options", "skipped"),
    [
        (470.0, 30.0, 20, {}, (10, 200)),
        (470.0, 3.0, 20, {"skip": 1500}, (1500, 1500)),
        (18.0, 20.0, 60, {}, (55, 200)),  # longer than the drive takes to erase the initial states
        (470.0, 0.5, 20, {}, (10, 200)),
        (470.0, 3.0, 20, {}, (10, 200)),
    ],
)
def test_a_transient_is_left_out_however_large_it_is_and_more_first_samples_may_be_skipped(
    period: float, size: float, length: int, options: dict[str, int], skipped: tuple[int, int]
) -> None:
    fit = identify(switched_on(period, size, length), **options).report["fit"]
    assert skipped[0] <= fit["skipped"] <= skipped[1]
    assert fit["rms_percent"] < 0.3


def test_validation_leaves_out_the_transient_that_identification_leaves_out_and_that_of_another_session() -> None:
    made = switched_on(470.0, 3.0, 20)
    model = identify(made)
    found = model.validate(made)
    assert found.fit.skipped == model.report["fit"]["skipped"] > 0
    assert found.fit.max_percent == pytest.approx(model.report["fit"]["max_percent"], rel=0.05)
    assert "as a switch-on transient" in " ".join(found.sentences())
    later = identify(switched_on(470.0, 0.0, 20)).validate(made).fit
    assert 10 <= later.skipped <= 200
    assert later.max_percent < 2.0


def test_an_extrapolation_is_not_taken_for_an_offset_of_the_sensor() -> None:
    rng, k = np.random.default_rng(2), np.arange(9000)
    u = np.sin(k / 200) * (0.4 + 0.6 * k / k.size)
    y = noisy(rng, np.tanh(1.5 * loops(rng, u, 0.15)), 0.001)
    model = identify(Recording.from_arrays(u[:4000], y[:4000], SAMPLE_TIME), n=5, m=3)
    wider = model.validate(Recording.from_arrays(u[4000:] + 0.5, y[4000:], SAMPLE_TIME))
    assert wider.beyond_percent > 20.0
    inside = np.abs(model.structure.unit_input(u[4000:] + 0.5)) <= 1.0
    error = y[4000:] - model.simulate(u[4000:] + 0.5, wider.states[0])
    assert wider.shift == pytest.approx(float(error[inside].mean()), abs=0.01 * np.ptp(y))
    assert "extrapolates" in " ".join(wider.sentences())


def test_a_single_outlier_is_named_with_its_sample_and_value() -> None:
    made, model = known()
    outlier = np.where(np.arange(made.length) == 4711, 1e6, made.y)
    spoiled = Recording.from_arrays(made.x, outlier, SAMPLE_TIME, output_unit="um")
    with pytest.raises(
        IdentificationError, match=r"the output is 1 m in sample 4711, and from .* in all others: an outlier"
    ):
        identify(spoiled, n=3, m=1)
    assert "in sample 4711" in " ".join(model.validate(spoiled).sentences())


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("threshold", "shift"),
    [(500.0, 0.0), (100.0, 300.0), (100.0, 0.0), (100.0, 150.0), (300.0, 0.0), (300.0, 150.0), (500.0, 150.0)],
)
def test_a_butterfly_of_any_width_is_refused_by_that_name(threshold: float, shift: float) -> None:
    t = np.arange(2000)
    for u in (np.sin(t / 100), np.sin(t / 100) * np.exp(-t / 3000), 0.6 * np.sin(t / 100) + 0.4 * np.sin(t / 37)):
        y = np.abs(play(1000.0 * u, [threshold], [0.0])[0][:, 0] + shift)
        with pytest.raises(
            IdentificationError, match=r"falls and rises again .* as the butterfly of a strain over a field does"
        ):
            identify(Recording.from_arrays(1000.0 * u, y, 1e-3))
