"""Creep and drift are in a model or a report where the recording determines them, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from known_models import a_drive, structure, true_model
from plain_stage import Vector, stage
from scipy.signal import sawtooth

from piezo_model import Dynamics, HysteresisCreepModel, ModelStructure, Recording, identify, plants
from piezo_model.identification.creep import ABSENT, INDISTINCT, UNDETERMINED
from piezo_model.signals import multi_sine

SAMPLE_TIME = 0.01
TIME = np.arange(6000) * SAMPLE_TIME


def triangle(cycles: Vector) -> Vector:
    """From 1 up to 9 V and back in each cycle."""
    return np.asarray(5.0 + 4.0 * sawtooth(2 * np.pi * cycles, 0.5))


def sine(cycles: Vector) -> Vector:
    return np.asarray(5.0 - 4.0 * np.cos(2 * np.pi * cycles))


def recorded(u: Vector, y: Vector, noise: float = 0.3) -> Recording:
    y = y + np.random.default_rng(0).normal(0, noise, u.size)
    return Recording.from_arrays(u, y, SAMPLE_TIME, input_unit="V", output_unit="um")


def of_stage(u: Vector, noise: float = 0.3, **states: float) -> Recording:
    return recorded(u, stage(u, **states), noise)


FAST = {
    "a triangle": triangle(TIME / 2),
    "a sine from another phase on": sine(TIME / 0.7 + 0.3),
    "ten loops": sine(TIME / 6),
    "one loop and a half": triangle(TIME / 40),
}
SLOW = triangle(np.arange(7500) / 5000)
STEP = np.concatenate([np.linspace(1, 6, 100), np.full(6000, 6.0)])


def worst(model: HysteresisCreepModel, u: Vector, creep: float = 0.0) -> float:
    """Largest error after the first quarter, per cent of the range of 320 µm, on average as offset as the sensor."""
    return 100 * float(np.ptp((model.simulate(u) - stage(u, creep=creep))[u.size // 4 :])) / 320.0


@pytest.mark.sample(3)
@pytest.mark.parametrize("kind", FAST)
def test_a_model_of_one_frequency_has_no_creep_and_holds_at_other_speeds_and_on_a_held_step(kind: str) -> None:
    made = of_stage(FAST[kind], before=5.0)
    model, without = identify(made), identify(made, creep_rates=())
    assert model.structure.creep_rates == ()
    assert model.weights.tolist() == without.weights.tolist()
    assert worst(model, SLOW) < 0.4
    assert worst(model, STEP) < 1e-9
    report, drive = model.report, model.report["drive"]
    assert {UNDETERMINED} == {*report["findings"]} & {*report["sentences"]} - {*without.report["sentences"]}
    # it is said once
    assert (drive["hysteresis"], drive["creep"], "creep" in drive["sentence"]) == (True, False, False)


@pytest.mark.parametrize(("then", "creep"), [(STEP, 0.01), (SLOW, 0.03)], ids=["a held step", "two speeds"])
def test_a_step_held_for_a_minute_and_two_speeds_determine_creep(then: Vector, creep: float) -> None:
    made = of_stage(np.concatenate([triangle(TIME / 2), then]), creep=creep)
    model, without = (identify(made, creep_rates=rates) for rates in (None, ()))
    assert model.structure.creep_rates
    assert (
        model.report["drive"]["creep"],
        model.report["creep"]["determined"],
        model.report["creep"]["sentence"],
    ) == (True, True, "")
    assert "shows creep, which the model does not include" in without.report["creep"]["sentence"]
    assert worst(model, STEP, creep) < 0.5 * worst(without, STEP, creep)


@pytest.mark.parametrize("noise", [0.0, 0.2])
@pytest.mark.parametrize("creep", [0.01, 0.0])
def test_tones_and_a_held_step_determine_creep_beside_noise_and_what_the_test_itself_cannot_describe(
    creep: float, noise: float
) -> None:
    truth = replace(true_model(structure(creep_rates=(10.0, 1.0, 0.1))), w_K=np.array([creep, 0.0, 0.0, 0.0]))
    x = np.pad(np.concatenate([np.linspace(0.0, 60.0, 100), a_drive(4000)]), (200, 3000), "edge")
    y = truth.simulate(x) + np.random.default_rng(1).normal(0.0, noise, x.size)
    assert bool(identify(Recording.from_arrays(x, y, 5e-3)).structure.creep_rates) == (creep > 0.0)


def test_a_drive_that_would_show_creep_says_so_where_there_is_none() -> None:
    model = identify(of_stage(np.concatenate([triangle(TIME / 2), STEP])))
    assert model.structure.creep_rates == ()
    assert ABSENT in model.report["findings"]
    assert UNDETERMINED not in model.report["sentences"]
    assert model.report["drive"]["sentence"].startswith("This drive determines hysteresis, creep")


def duhem(u: Vector, rate: float) -> Vector:
    """Output of a Duhem operator, which has no return-point memory, between the slopes 0.85 and 1."""
    output, followed = np.empty_like(u), u[0]
    output[0] = u[0]
    for k in range(1, u.size):
        change = u[k] - u[k - 1]
        followed += rate * abs(change) * (u[k - 1] - followed) + 0.85 * change
        output[k] = followed
    return output


@pytest.mark.sample(3)
@pytest.mark.parametrize("cycles", [TIME / 2, TIME / 0.7, TIME / 9])
@pytest.mark.parametrize("rate", [0.1, 0.3])
def test_no_loop_of_one_frequency_is_taken_for_creep_whatever_hysteresis_it_is(rate: float, cycles: Vector) -> None:
    report = identify(recorded(sine(cycles), 40 * duhem(sine(cycles), rate), noise=1.0)).report
    assert (report["creep"]["determined"], [*report["creep"]["rates"]], report["drift"]) == (False, [], None)


@pytest.mark.parametrize("before", [1.0, 5.0])
def test_creep_of_one_frequency_is_not_called_a_drift_and_no_part_of_the_model(before: float) -> None:
    model = identify(of_stage(FAST["ten loops"], creep=0.03, before=before))
    assert (model.structure.creep_rates, model.report["drift"]) == ((), None)
    assert UNDETERMINED in model.report["findings"]


@pytest.mark.parametrize("kind", ["dense_prandtl_ishlinskii", "relay_preisach"])
def test_a_lag_of_a_smooth_output_is_not_taken_for_creep(kind: str) -> None:
    u = 5.0 - 2.5 * np.cos(0.4 * np.pi * TIME) * (1.0 + 0.5 * np.sin(TIME / 5))
    y = plants.get(kind, sample_time=SAMPLE_TIME, x_range=(0.0, 10.0), creep_share=0.0).run(u)
    late = Dynamics((), (), (), 2.0 * SAMPLE_TIME).filter(y, SAMPLE_TIME)
    assert not identify(recorded(u, late, 1e-4 * float(np.ptp(y)))).structure.creep_rates


def test_given_rates_are_used_and_said_to_be_a_guess_where_the_recording_determines_no_creep() -> None:
    given = identify(of_stage(FAST["a triangle"]), n=5, m=3, creep_rates=(1.0,))
    assert given.structure.creep_rates == (1.0,)
    assert any(finding.startswith("Creep at the rates specified is a guess.") for finding in given.report["findings"])


@pytest.mark.parametrize(("name", "seed"), [("relay_preisach", 2), ("bouc_wen", 1), ("maxwell_slip", 3)])
def test_creep_that_the_hysteresis_hides_is_not_said_to_be_absent(name: str, seed: int) -> None:
    u = multi_sine(duration_s=6.0, sample_time=1e-3, low=0.0, high=150.0, highest_Hz=10.0, seed=seed)
    y = plants.get(name, sample_time=1e-3).run(u) + np.random.default_rng(5).normal(0.0, 0.02, u.size)
    model = identify(Recording.from_arrays(u, y, 1e-3))
    assert model.report["creep"]["rates"]
    assert INDISTINCT in model.report["findings"]
    assert "creep" not in model.report["drive"]["sentence"]


def test_a_drift_beside_one_frequency_is_named_but_may_be_creep_and_no_part_of_the_model() -> None:
    u = FAST["a triangle"]
    model = identify(recorded(u, stage(u) - 0.15 * TIME))
    found = model.report["drift"]
    assert model.structure.creep_rates == ()
    assert found["per_s"] == pytest.approx(-0.15, abs=3.0 * found["se"] + 1e-3)
    assert found["rms_percent"] < 0.15 < model.report["fit"]["rms_percent"]
    named = "The output drifts by -0.15 µm/s, owing to creep or to the sensor. The model does not include the drift"
    assert named in " ".join(model.report["findings"])
    assert worst(model, SLOW) < 0.4


def test_a_drift_beside_creep_that_is_determined_is_called_one_of_the_sensor() -> None:
    u = np.concatenate([triangle(TIME / 2), SLOW])
    model = identify(recorded(u, stage(u, creep=0.03) - 0.15 * SAMPLE_TIME * np.arange(u.size)))
    assert model.structure.creep_rates
    assert any(sentence.startswith("The sensor drifts by -0.15 µm/s.") for sentence in model.report["findings"])


@pytest.mark.parametrize("held_samples", [50, 500])
def test_creep_from_before_the_recording_is_a_settling_and_no_drift(held_samples: int) -> None:
    u = FAST["a triangle"]
    before = np.concatenate([np.full(100_000, 9.0), np.full(held_samples, u[0])])
    model = identify(recorded(u, stage(np.concatenate([before, u]), creep=0.03)[before.size :]))
    assert model.report["drift"] is None
    assert model.report["settling"]["rms_percent"] < 0.12 < model.report["fit"]["rms_percent"]
    assert "µm, as creep does after a movement. The model does not include" in " ".join(model.report["findings"])


def test_a_recording_that_begins_while_the_stage_creeps_is_validated_from_the_states_that_it_has_then() -> None:
    u = np.concatenate([STEP, np.full(900, 6.0), triangle(TIME / 6)[:3000], triangle(TIME / 0.5)[:2000]])
    whole = of_stage(u, noise=0.1, creep=0.02)
    model = identify(whole)
    known = model.validate(whole).fit.rms
    assert model.validate(whole.part(slice(6000, None))).fit.rms == pytest.approx(known, rel=0.2)
    assert known < 0.5


@pytest.mark.parametrize("rates", [(30.0, 3.0, 0.3), (100.0, 10.0, 1.0, 0.1), (5.0, 0.5), (2.0,)])
def test_figures_are_those_of_the_stage_whatever_the_rates_of_its_creep_and_the_offset_has_no_interval(
    rates: tuple[float, ...],
) -> None:
    made = ModelStructure.equidistant(5, 3, (0.0, 100.0), (0.0, 20.0), rates, 5e-3)
    w = made.straight_line.copy()
    w[made.slices[0]], w[made.slices[2].start] = [0.1, 0.08, 0.05, 0.04, 0.03], 0.02
    truth = HysteresisCreepModel.from_weights(made, w)
    rng, t = np.random.default_rng(1), np.arange(12_000) * 5e-3
    u = np.where(t % 5.0 < 2.5, np.repeat(rng.uniform(0.0, 100.0, 12), 1000), 50.0 + 50.0 * np.sin(4.0 * np.pi * t))
    y = truth.simulate(u)
    model = identify(Recording.from_arrays(u, y + 1e-3 * np.ptp(y) * rng.normal(size=y.size), 5e-3))
    figures, true = (
        np.array([*model.figures().values()], dtype=float),
        [value for value, *_ in truth.figures().values()],
    )
    assert figures[:3, 0] == pytest.approx(true[:3], rel=0.1)
    assert figures[0, 0] == pytest.approx(true[0], rel=3e-3)
    assert np.all((figures[:3, 1] <= true[:3]) & (true[:3] <= figures[:3, 2])), figures
    assert model.figures()["offset"][1:] == (None, None)
