"""From the file of an instrument to the code of a controller, by the command line alone: everything made from a forced
model carries the warning; a stage with a resonance is compensated with and without lag, and refused by what cannot.
"""

import json
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from command_line import CommandLine, contents
from programs import library
from small_races import REFERENCE

from bench.deploy.deployment import Deployment
from piezo_model import Dynamics, HysteresisCreepModel, ModelStructure, OperatorState, plants
from piezo_model.recordings import read_reference, write_table
from piezo_model.units import quantity

MS = 1e-3


@pytest.mark.needs("cc")
def test_a_falling_output_gives_the_controllers_of_the_negated_data(piezobench: CommandLine, tmp_path: Path) -> None:
    fmpy = library("fmpy")
    t = np.arange(8000) * MS
    x = 75.0 + 70.0 * np.sin(2 * np.pi * 0.7 * t) * (0.4 + 0.6 * t / t[-1])
    y = plants.get("relay_preisach", sample_time=MS).run(x)
    reference = y.mean() + 0.3 * np.ptp(y) * np.sin(2 * np.pi * 1.3 * t[:2000])
    drives = {}
    for name, sign in (("rising", 1.0), ("falling", -1.0)):
        folder = tmp_path / name
        folder.mkdir()
        write_table(folder / "stage.csv", {"time_s": t, "drive_V": x, "position_um": sign * y})
        write_table(folder / "wish.csv", {"time_s": t[:2000], "reference_um": sign * reference})
        for words in (
            ("identify", "stage.csv", "--out", "model.json"),
            ("compensate", "model.json", "wish.csv", "--start", "rest", "--out", "drive.csv"),
            ("export-fmu", "model.json", "it.fmu"),
        ):
            piezobench.run(*words, folder=folder)
        assert (
            "falls as the input rises" in json.dumps(json.loads((folder / "model.json").read_text())["report"])
        ) == (sign < 0.0)
        signals = np.rec.fromarrays([t[:2000], sign * reference], names="time,reference")
        found = fmpy.simulate_fmu(
            str(folder / "it.fmu"),
            stop_time=2000 * MS,
            step_size=MS,
            output_interval=MS,
            input=signals,
            output=["drive"],
            fmi_type="CoSimulation",
        )["drive"][1:]
        compensated = np.loadtxt(folder / "drive.csv", delimiter=",", skiprows=1)[:, 1]
        np.testing.assert_allclose(found, compensated, rtol=0, atol=1e-9)
        drives[name] = found, compensated
    assert np.ptp(drives["rising"][0]) > 20.0
    for rising, falling in zip(drives["rising"], drives["falling"], strict=True):
        np.testing.assert_array_equal(falling, rising)


WARNING = "The model was forced although the model class does not describe these data"


@pytest.fixture(scope="module")
def desk(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, chance, k = tmp_path_factory.mktemp("desk"), np.random.default_rng(0), np.arange(4000)
    write_table(
        folder / "noise.csv",
        {"time_s": k * MS, "voltage_V": np.sin(k / 100), "displacement_um": chance.standard_normal(k.size)},
    )
    write_table(folder / "wish.csv", {"time_s": k[:500] * MS, "reference_um": 0.1 * np.sin(k[:500] / 100)})
    words = ("identify", "noise.csv", "--out", "model.json", "--n", 2, "--m", 1)
    before = contents(folder)
    assert "noise.csv: the model class does not describe these data" in piezobench(*words, folder=folder).refusal
    assert contents(folder) == before
    assert WARNING in piezobench.run(*words, "--force", folder=folder).said
    return folder


@pytest.mark.needs("cc")
def test_exported_sources_their_description_an_fmu_and_the_table_of_a_fleet_carry_the_warning(
    piezobench: CommandLine, desk: Path, tmp_path: Path
) -> None:
    call = piezobench.run("export-c", desk / "model.json", tmp_path / "c")
    piezobench.run("export-fmu", desk / "model.json", tmp_path / "it.fmu")
    piezobench.run("identify", desk / "noise.csv", "--out-dir", tmp_path / "fleet", "--force", "--n", 1, "--m", 0)
    (forced,) = pd.read_csv(tmp_path / "fleet" / "fleet.csv").forced
    texts = {
        "said": call.stderr.replace("\n", " "),
        "fleet": forced,
        "FMU": zipfile.Path(tmp_path / "it.fmu", "modelDescription.xml").read_text("utf-8"),
        **{name: (tmp_path / "c" / name).read_text() for name in ("README.md", "piezo_parameters.h")},
    }
    assert [name for name, text in texts.items() if WARNING not in text] == []


@pytest.mark.parametrize(
    "words",
    [
        ("compensate", "model.json", "wish.csv", "--out", "drive.csv"),
        ("simulate", "model.json", "noise.csv", "--out", "output.csv"),
        ("validate", "model.json", "noise.csv"),
    ],
)
def test_results_of_a_forced_model_are_printed_with_the_warning(
    piezobench: CommandLine, desk: Path, words: tuple[str, ...]
) -> None:
    assert WARNING in piezobench(*words, folder=desk).stdout
    found = json.loads(piezobench(*words, "--json", folder=desk).stdout)
    assert WARNING in (found["sentences"][0] if words[0] == "validate" else found["forced"])


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("verb", ["compensate", "simulate"])
def test_a_table_made_from_a_forced_model_is_marked_and_read_all_the_same(
    piezobench: CommandLine, desk: Path, tmp_path: Path, verb: str, suffix: str
) -> None:
    out, given = tmp_path / f"made{suffix}", {"compensate": "wish.csv", "simulate": "noise.csv"}[verb]
    piezobench.run(verb, desk / "model.json", desk / given, "--out", out)
    if suffix == ".csv":
        assert re.match(f"# {WARNING}.*\ntime_s,drive_V", out.read_text())
    else:
        assert WARNING in pq.read_schema(out).metadata[b"remark"].decode()
    drive = read_reference(out, column="drive_V", role="input")
    assert (drive.sample_time, drive.values.size) == (MS, 500 if verb == "compensate" else 4000)


T = 1e-4
LEFT_OUT = "The model has no dynamics although the stage has a resonance at"
FASTEST = "has only the static gain of the fastest modes although the stage has a resonance at 400 Hz"


@pytest.fixture(scope="module")
def ringing(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recorded steps of a stage, a triangle as a reference, and the identified model."""
    folder = tmp_path_factory.mktemp("ringing")
    structure = ModelStructure.equidistant(3, 1, (0.0, 100.0), (0.0, 20.0), (), T)
    truth = replace(
        HysteresisCreepModel.from_weights(structure, [0.1, 0.1, 0.1, 0.9, 0.1, 0.1]),
        dynamics=Dynamics((400.0,), (0.02,), (1.0,), 1.5 * T),
        start=OperatorState.settled_at(structure, 0.0),
    )
    x = np.repeat(np.r_[0.0, np.random.default_rng(1).uniform(0.0, 100.0, 99)], 200)
    y = truth.simulate(x) + 1e-3 * np.random.default_rng(2).standard_normal(x.size)
    t = np.arange(x.size) * T
    write_table(folder / "stage.csv", {"time_s": t, "voltage_V": x, "displacement_um": y})
    odd = 400.0 / 9.0  # a triangle has odd harmonics alone, here one on the resonance
    triangle = np.minimum(3.0 + 12.0 * np.abs(2.0 * ((odd * t) % 1.0) - 1.0), 150.0 * t)
    write_table(folder / "scan.csv", {"time_s": t, "reference_um": triangle})
    write_table(folder / "slow.csv", {"time_s": 10.0 * t, "reference_um": triangle, "voltage_V": x})
    words = ("identify", "stage.csv", "--n", 3, "--m", 1, "--rates", "none")
    piezobench.run(*words, "--out", "0.json", folder=folder)
    piezobench.run(*words, "--out", "2.json", "--dynamics", "ignore", folder=folder)
    return folder


def test_the_model_has_the_resonance_and_without_it_has_a_large_error(ringing: Path) -> None:
    model, ignored = (HysteresisCreepModel.load(ringing / name) for name in ("0.json", "2.json"))
    assert model.dynamics.frequencies_Hz[0] == pytest.approx(400.0, rel=1e-3)
    assert ignored.dynamics is None
    assert ignored.report["fit"]["rms_percent"] > 5.0


def test_a_scan_is_compensated_after_a_declared_lag_without_lag_or_not_at_all(
    piezobench: CommandLine, ringing: Path, tmp_path: Path
) -> None:
    results = {}
    for option in ("--dynamics", "--preview", "--no-dynamics"):
        words = ("compensate", ringing / "0.json", ringing / "scan.csv", "--out", f"{option}.csv", option, "--json")
        results[option] = json.loads(piezobench.run(*words, folder=tmp_path).stdout)
    lag = HysteresisCreepModel.load(ringing / "0.json").dynamics.lag_s(T)
    inverted, previewed, static = results.values()
    assert [result["lag_s"] for result in results.values()] == [pytest.approx(lag), 0.0, 0.0]
    assert max(inverted["rms_percent"], previewed["rms_percent"]) < 1.0
    assert static["rms_percent"] > 2.0 * inverted["rms_percent"]
    call = piezobench("compensate", ringing / "0.json", ringing / "scan.csv", "--out", tmp_path / "x.csv")
    assert f"The output lags the reference by {quantity(lag, 's', 3)}, after which" in call.stdout


@pytest.mark.parametrize(
    ("words", "written"),
    [
        (("compensate", "0.json", "slow.csv", "--out", "x.csv"), "x.csv"),
        (("simulate", "0.json", "slow.csv", "--out", "x.csv"), "x.csv"),
        (
            ("validate", "0.json", "slow.csv", "--input", "voltage_V", "--output", "reference_um", "--page", "x.html"),
            "x.html",
        ),
        (("export-c", "0.json", "c", "--rate", 1000), "c/README.md"),
    ],
    ids=str,
)
def test_a_mode_too_fast_for_the_sampling_rate_of_a_file_or_a_controller_is_its_static_gain_with_a_warning(
    piezobench: CommandLine, ringing: Path, tmp_path: Path, words: tuple[object, ...], written: str
) -> None:
    call = piezobench(*(ringing / word if word in ("0.json", "slow.csv") else word for word in words), folder=tmp_path)
    assert FASTEST in " ".join((call.stdout + call.stderr).split())
    assert FASTEST in " ".join((tmp_path / written).read_text(encoding="utf-8").split())


@pytest.mark.parametrize("left_out", [False, True])
def test_exports_invert_the_dynamics_and_carry_the_lag_as_a_constant_or_have_the_static_part_and_the_warning(
    piezobench: CommandLine, ringing: Path, tmp_path: Path, left_out: bool
) -> None:
    for words in (("export-c", ringing / "0.json", "c"), ("export-fmu", ringing / "0.json", "stage.fmu")):
        call = piezobench.run(*words, *["--no-dynamics"] * left_out, folder=tmp_path)
        assert (LEFT_OUT in " ".join(call.stderr.split())) == left_out
    description = zipfile.Path(tmp_path / "stage.fmu", "modelDescription.xml").read_text("utf-8")
    assert (LEFT_OUT in description) == left_out
    lag = repr(HysteresisCreepModel.load(ringing / "0.json").dynamics.lag_s(T))
    if left_out:
        assert re.search(
            rf"{LEFT_OUT} 400 Hz with damping [0-9.]+ %, a delay of [0-9.]+ us\.",
            (tmp_path / "c" / "README.md").read_text("utf-8"),
        )
    else:
        assert f"#define PIEZO_LAG_S {lag}\n" in (tmp_path / "c" / "piezo_parameters.h").read_text("utf-8")
        assert re.search(rf'name="lag" [^/]*variability="constant" [^/]*start="{re.escape(lag)}"', description)


@pytest.mark.sample(1)
@pytest.mark.parametrize("left_out", [True, False])
def test_the_model_is_deployed_and_learns_with_its_dynamics_or_with_a_warning(
    piezobench: CommandLine, ringing: Path, tmp_path: Path, left_out: bool
) -> None:
    out, option = tmp_path / "c.json", ("--no-dynamics",) if left_out else ()
    deploy = ("deploy", REFERENCE, "--model", ringing / "0.json", "--deadline", 1e6, "--out", out, *option)
    live = ("live", ringing / "0.json", "--simulate", "relay_preisach", "--rate", 1 / T, "--seconds", 0.2, "--no-page")
    for words in (deploy, (*live, *option)):
        assert (LEFT_OUT in piezobench.run(*words).said) == left_out
    model = Deployment.load(out).model
    assert (LEFT_OUT in model.warning) == left_out == (model.dynamics is None)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (
            ("compensate", "2.json", "scan.csv", "--out", "x.csv", "--preview"),
            "the model has no dynamics, so --preview",
        ),
        (("compensate", "0.json", "scan.csv", "--out", "x.csv", "--preview", "--no-dynamics"), "inverts the dynamics"),
        *(
            (
                (*words, "--integral-gain", gain, *option),
                f" per second, not {gain}: with a resonance at 400 Hz",
            )
            for words in (
                ("export-c", "0.json", "c"),
                ("export-fmu", "0.json", "x.fmu"),
                ("live", "0.json", "--simulate", "relay_preisach", "--rate", 1 / T, "--seconds", 0.1, "--no-page"),
            )
            for gain, option in ((5000, ()), (500, ("--no-dynamics",)))
        ),
        (
            ("identify", "stage.csv", "--out", "x.json", "--dynamics", "guess"),
            "'guess' is not one of 'estimate', 'ignore'",
        ),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_sentence_and_nothing_is_written(
    piezobench: CommandLine, ringing: Path, words: tuple[object, ...], reason: str
) -> None:
    before = contents(ringing)
    call = piezobench(*words, folder=ringing)
    assert call.status != 0
    assert reason in " ".join(call.stderr.replace("│", " ").split())
    assert contents(ringing) == before
