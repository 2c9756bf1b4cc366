"""The model of a recording: judged on the last fifth, fitted to all of it, deployed, and preferred to a worse one."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import plain_stage
import pytest
from command_line import CommandLine
from small_races import race_of

from bench.deploy.actuator_model import model_for
from bench.deploy.deployment import Deployment
from bench.problems.recorded import held_out_recording
from bench.store import Run, RunError
from piezo_model import HysteresisCreepModel, Recording, identify, plants
from piezo_model.identification.creep import UNDETERMINED
from piezo_model.recordings import write_table

FEW = ("--limit", 2, "--solver", "box_active_set", "--lane", "direct", "--budget", 0.002, "--rounds", 0)
LONG = ("--deadline", 1e6)


def stage(folder: Path, kind: str, samples: int = 12_000) -> tuple[Path, Recording]:
    """A recording of a simulated actuator with a noisy sensor, and later data of the same actuator."""
    chance, plant = np.random.default_rng(3), plants.get(kind, sample_time=1e-3)
    t, (low, high) = np.arange(2 * samples) * 1e-3, plant.x_range
    waves = (
        0.5 * np.sin(2 * np.pi * 0.7 * t)
        + 0.3 * np.sin(2 * np.pi * 1.9 * t + 1)
        + 0.2 * np.sin(2 * np.pi * 3.7 * t + 2)
    )
    x = 0.5 * (low + high) + 0.5 * (high - low) * waves
    y = plant.run(x) + 1e-3 * np.ptp(plant.y_range) * chance.normal(size=t.size)
    path = folder / f"{kind}.csv"
    write_table(path, {"time_s": t[:samples], "voltage_V": x[:samples], "displacement_um": y[:samples]})
    return path, Recording.from_arrays(x[samples:], y[samples:], 1e-3, input_unit="V", output_unit="um", name="later")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Recording, Run]:
    folder = tmp_path_factory.mktemp("recorded")
    path, later = stage(folder, "bouc_wen")
    return path, later, race_of(folder, "run", "--recording", path, *FEW).run


def test_the_model_of_all_of_a_recording_is_kept_and_deployed_with_the_error_of_that_of_four_fifths_on_the_last(
    piezobench: CommandLine, recorded: tuple[Path, Recording, Run], tmp_path: Path
) -> None:
    path, _, run = recorded
    whole = Recording.open(path)
    fitted, unseen = (
        Recording.from_arrays(whole.x[part], whole.y[part], 1e-3, input_unit="V", output_unit="um")
        for part in (slice(round(0.8 * whole.length)), slice(round(0.8 * whole.length), None))
    )
    weights = identify(whole).weights.tolist()
    assert HysteresisCreepModel.load(run.model_path("recorded")).weights.tolist() == weights
    error = run.settings["models"]["recorded"]["error_percent"]
    assert error == pytest.approx(identify(fitted).validate(unseen).fit.rms_percent, rel=1e-9)
    assert "deploy uses the model of the whole recording." in (run.path / "report.md").read_text()
    assert (
        "Model: from the recording of the race. Fitted to the first four fifths alone, its RMS error is "
        f"{error:.3g} % of the range on the last, which was held out."
    ) in piezobench.run("deploy", run.path, *LONG, "--out", tmp_path / "c.json").said
    deployed = Deployment.load(tmp_path / "c.json")
    assert deployed.model.weights.tolist() == weights
    assert (deployed.evidence["error_percent"], deployed.evidence["last_fifth"]) == (error, "held out, then fitted")


def test_a_model_with_a_ten_percent_larger_error_is_refused_with_both_errors(
    piezobench: CommandLine, recorded: tuple[Path, Recording, Run], tmp_path: Path
) -> None:
    *_, run = recorded
    kept, model = run.settings["models"]["recorded"]["error_percent"], model_for(run).model
    unseen = held_out_recording(run.problem("recorded", run.settings["problems"]["recorded"][0]))
    plays = np.arange(model.weights.size) < model.structure.n
    bad = HysteresisCreepModel.from_weights(model.structure, np.where(plays, 2.0, 1.0) * model.weights)
    bad.save(tmp_path / "bad.json")
    assert (
        f"bad.json has an RMS error of {bad.validate(unseen).fit.rms_percent:.3g} % of the range on the last fifth of "
        f"the recording, and one of the first four fifths {kept:.3g} %; leave out --model and --problem to take the "
        "run's"
    ) in piezobench("deploy", run.path, *LONG, "--model", "bad.json", "--out", "c.json", folder=tmp_path).refusal
    assert not (tmp_path / "c.json").exists()


def test_a_model_in_other_units_than_the_recording_of_the_race_is_judged_in_its_own(
    piezobench: CommandLine, recorded: tuple[Path, Recording, Run], tmp_path: Path
) -> None:
    path, _, run = recorded
    opened = Recording.open(path)
    identify(opened.in_units("mV", "nm"), n=5, m=3, creep_rates=(10.0, 1.0)).save(tmp_path / "small.json")
    identify(opened, n=5, m=3, creep_rates=(10.0, 1.0)).save(tmp_path / "model.json")
    small, usual = (
        piezobench.run("deploy", run.path, *LONG, "--model", name, "--out", f"c-{name}", "--json", folder=tmp_path)
        for name in ("small.json", "model.json")
    )
    assert json.loads(small.stdout)["error_percent"] == pytest.approx(
        json.loads(usual.stdout)["error_percent"], rel=1e-3
    )
    assert Deployment.load(tmp_path / "c-small.json").model.structure.input_unit == "mV"


@pytest.mark.parametrize(
    ("how", "last_fifth"),
    [
        ("whole", "fitted"),
        ("four fifths", "held out"),
        ("problem", "held out"),
        pytest.param("skip", "fitted", marks=pytest.mark.slow),
        pytest.param("four fifths and whole", "fitted", marks=pytest.mark.slow),
        pytest.param("half", "not known", marks=pytest.mark.slow),
        pytest.param("resampled", "not known", marks=pytest.mark.slow),
        pytest.param("later", "not known", marks=pytest.mark.slow),
    ],
)
def test_only_a_model_of_the_first_four_fifths_is_said_to_be_judged_on_held_out_data(
    piezobench: CommandLine, recorded: tuple[Path, Recording, Run], tmp_path: Path, how: str, last_fifth: str
) -> None:
    path, later, run = recorded
    recording = Recording.open(path)
    x, y, orders = recording.x, recording.counted_y, ("--n", 5, "--m", 3, "--rates", "100,10,1,0.1")
    stop = x.size // 2 if how == "half" else round(0.8 * x.size) if how.startswith("four fifths") else x.size
    if how == "later":
        x, y = later.x, later.counted_y
    write_table(
        tmp_path / "part.csv", {"time_s": np.arange(stop) * 1e-3, "voltage_V": x[:stop], "displacement_um": y[:stop]}
    )
    words: tuple[object, ...] = ("--problem", "recorded/n5-m3-whole")
    if how != "problem":
        further = {"skip": ("--skip", 500), "resampled": ("--resample", 0.001000001), "four fifths and whole": (path,)}
        piezobench.run(
            "identify", tmp_path / "part.csv", *further.get(how, ()), "--out", tmp_path / "model.json", *orders
        )
        words = ("--model", tmp_path / "model.json")
    call = piezobench.run("deploy", run.path, *LONG, *words, "--out", tmp_path / "c.json")
    assert Deployment.load(tmp_path / "c.json").evidence["last_fifth"] == last_fifth
    phrases = {
        "fitted": "the recording, to which it was fitted, its RMS error is",
        "held out": "the recording, which was held out, its RMS error is",
        "not known": "% of the range; whether it was fitted to it is not known.",
    }
    assert {name for name, phrase in phrases.items() if phrase in call.said} == {last_fifth}


@pytest.mark.slow
def test_a_recording_without_a_model_is_raced_and_deploy_gives_the_reason(
    piezobench: CommandLine, tmp_path: Path
) -> None:
    chance, t = np.random.default_rng(0), np.arange(4000) * 1e-3
    write_table(
        tmp_path / "noise.csv",
        {"time_s": t, "voltage_V": 50 - 50 * np.cos(2 * np.pi * t), "displacement_um": chance.normal(size=t.size)},
    )
    run = race_of(tmp_path, "run", "--recording", tmp_path / "noise.csv", *FEW).run
    reason = run.settings["models"]["recorded"]["refused"]
    assert reason.startswith(f"{tmp_path / 'noise.csv'}, samples 0 to 3199: ")
    assert not run.model_path("recorded").exists()
    assert (
        "There is no model of the recording for deploy, since identify refused it: "
        in (run.path / "report.md").read_text()
    )
    assert (
        f"keeps no model of its recording, since identify refused it ({reason}); give a model with --model, or name "
        "a problem"
    ) in piezobench("deploy", run.path, *LONG).refusal
    with pytest.raises(RunError, match="holds no model of a simulated actuator"):
        model_for(run, simulated=True)


def test_one_frequency_gives_a_model_without_creep_from_the_race_to_the_controller(
    piezobench: CommandLine, tmp_path: Path
) -> None:
    chance, t = np.random.default_rng(0), np.arange(6000) * 0.01
    u = 1 + 8 * np.interp(t / 2 % 1, [0, 0.5, 1], [0, 1, 0])
    y = plain_stage.stage(u)
    write_table(tmp_path / "a.csv", {"time_s": t, "voltage_V": u, "position_um": y + chance.normal(0, 0.3, t.size)})
    run = race_of(tmp_path, "run", "--recording", tmp_path / "a.csv", *FEW).run
    assert f"of the whole recording. {UNDETERMINED}" in (run.path / "report.md").read_text()
    assert UNDETERMINED in piezobench.run("deploy", run.path, *LONG, "--out", tmp_path / "c.json").said
    model = Deployment.load(tmp_path / "c.json").model
    held = np.concatenate([np.linspace(1, 6, 50), np.full(6000, 6.0)])  # a step, held for a minute
    error = (model.simulate(held) - plain_stage.stage(held))[50:]
    assert np.ptp(error) == 0.0
    assert np.abs(error[0]) < 0.001 * np.ptp(y)


def test_missing_outputs_pass_through_identify_its_page_validate_a_fleet_and_a_race_on_two_files(
    piezobench: CommandLine, tmp_path: Path
) -> None:
    recording = Recording.open(stage(tmp_path, "bouc_wen", 5000)[0])
    x, y = recording.x, recording.y.copy()
    y[[0, 1, 700, 2500, 2501, 4700]] = np.nan
    table = pd.DataFrame({"time_s": np.arange(x.size) * 1e-3, "voltage_V": x, "displacement_um": y})
    for name in ("a", "b"):
        table.to_parquet(tmp_path / f"{name}.parquet")
    one, words = tmp_path / "a.parquet", ("--n", 3, "--m", 1, "--rates", "10")
    for verb in (("identify", one, *words, "--out", tmp_path / "m.json"), ("validate", tmp_path / "m.json", one)):
        assert (
            "over 4994 of 5000 samples (6 not counted)"
            in piezobench.run(*verb, "--page", tmp_path / f"{verb[0]}.html").said
        )
        assert "NaN" not in (tmp_path / f"{verb[0]}-figures" / "error.csv").read_text()
    piezobench.run("identify", one, tmp_path / "b.parquet", "--out-dir", tmp_path / "fleet", *words)
    two = ("--input", f"{one}:voltage_V", "--output", f"{tmp_path / 'b.parquet'}:displacement_um")
    race = race_of(tmp_path, "run", *two, *FEW)
    assert 0.0 < race.run.settings["models"]["recorded"]["error_percent"] < 2.0
    assert race.rows.query("solver == 'box_active_set'").model_error_percent.between(0.0, 2.0).all()
