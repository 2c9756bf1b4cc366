"""A stage with a resonance on the command line: identified, compensated with and without lag, and refused by what
cannot compensate it."""

import json
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine, contents
from small_races import REFERENCE

from bench.deploy.deployment import Deployment
from piezo_model import Dynamics, HysteresisCreepModel, ModelStructure, OperatorState
from piezo_model.recordings import write_table
from piezo_model.units import quantity

T = 1e-4
DYNAMICS = Dynamics((400.0,), (0.02,), (1.0,), 1.5 * T)
LEFT_OUT = "The model has no dynamics although the stage has a resonance at"
FASTEST = "has only the static gain of the fastest modes although the stage has a resonance at 400 Hz"


@pytest.fixture(scope="module")
def desk(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recorded steps of a stage, a triangle as a reference, and the identified model."""
    folder = tmp_path_factory.mktemp("ringing")
    structure = ModelStructure.equidistant(3, 1, (0.0, 100.0), (0.0, 20.0), (), T)
    truth = replace(
        HysteresisCreepModel.from_weights(structure, [0.1, 0.1, 0.1, 0.9, 0.1, 0.1]),
        dynamics=DYNAMICS,
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
    words = ("--n", 3, "--m", 1, "--rates", "none")
    for options in ((), ("--dynamics", "ignore")):
        piezobench.run("identify", "stage.csv", "--out", f"{len(options)}.json", *words, *options, folder=folder)
    return folder


def test_the_model_has_the_resonance_and_without_it_has_a_large_error(desk: Path) -> None:
    model, ignored = (HysteresisCreepModel.load(desk / name) for name in ("0.json", "2.json"))
    assert model.dynamics.frequencies_Hz[0] == pytest.approx(400.0, rel=1e-3)
    assert ignored.dynamics is None
    assert ignored.report["fit"]["rms_percent"] > 5.0


def test_a_scan_is_compensated_after_a_declared_lag_without_lag_or_not_at_all(
    piezobench: CommandLine, desk: Path, tmp_path: Path
) -> None:
    results = {}
    for option in ("--dynamics", "--preview", "--no-dynamics"):
        out = tmp_path / f"{option}.csv"
        call = piezobench.run("compensate", desk / "0.json", desk / "scan.csv", "--out", out, option, "--json")
        results[option] = json.loads(call.stdout)
    lag = HysteresisCreepModel.load(desk / "0.json").dynamics.lag_s(T)
    inverted, previewed, static = results.values()
    assert [result["lag_s"] for result in results.values()] == [pytest.approx(lag), 0.0, 0.0]
    assert max(inverted["rms_percent"], previewed["rms_percent"]) < 1.0
    assert static["rms_percent"] > 2.0 * inverted["rms_percent"]
    call = piezobench("compensate", desk / "0.json", desk / "scan.csv", "--out", tmp_path / "x.csv")
    assert f"The output lags the reference by {quantity(lag, 's', 3)}, after which" in call.stdout


@pytest.mark.parametrize(
    "words",
    [
        ("compensate", "--out", "x.csv"),
        ("simulate", "--out", "x.csv"),
        ("validate", "--input", "voltage_V", "--output", "reference_um", "--page", "x.html"),
    ],
    ids=lambda words: words[0],
)
def test_a_mode_too_fast_for_the_sampling_rate_of_a_file_is_its_static_gain_with_a_warning(
    piezobench: CommandLine, desk: Path, tmp_path: Path, words: tuple[str, ...]
) -> None:
    call = piezobench(words[0], desk / "0.json", desk / "slow.csv", *words[1:], folder=tmp_path)
    assert FASTEST in " ".join((call.stdout + call.stderr).split())
    assert FASTEST in (tmp_path / words[-1]).read_text(encoding="utf-8")


@pytest.mark.parametrize("left_out", [False, True])
def test_exports_invert_the_dynamics_and_carry_the_lag_as_a_constant_or_have_the_static_part_and_the_warning(
    piezobench: CommandLine, desk: Path, tmp_path: Path, left_out: bool
) -> None:
    for words in (("export-c", desk / "0.json", "c"), ("export-fmu", desk / "0.json", "stage.fmu")):
        call = piezobench.run(*words, *["--no-dynamics"] * left_out, folder=tmp_path)
        assert (LEFT_OUT in " ".join(call.stderr.split())) == left_out
    with zipfile.ZipFile(tmp_path / "stage.fmu") as archive:
        description = archive.read("modelDescription.xml").decode()
    assert (LEFT_OUT in description) == left_out
    lag = repr(HysteresisCreepModel.load(desk / "0.json").dynamics.lag_s(T))
    if left_out:
        readme = (tmp_path / "c" / "README.md").read_text("utf-8")
        assert re.search(rf"{LEFT_OUT} 400 Hz with damping [0-9.]+ %, a delay of [0-9.]+ us\.", readme)
    else:
        assert f"#define PIEZO_LAG_S {lag}\n" in (tmp_path / "c" / "piezo_parameters.h").read_text("utf-8")
        assert re.search(rf'name="lag" [^/]*variability="constant" [^/]*start="{re.escape(lag)}"', description)


@pytest.mark.parametrize("left_out", [False, True])
def test_the_model_is_deployed_and_learns_with_its_dynamics_or_with_a_warning(
    piezobench: CommandLine, desk: Path, tmp_path: Path, left_out: bool
) -> None:
    out, option = tmp_path / "c.json", ("--no-dynamics",) if left_out else ()
    deploy = ("deploy", REFERENCE, "--model", desk / "0.json", "--deadline", 1e6, "--out", out, *option)
    live = ("live", desk / "0.json", "--simulate", "relay_preisach", "--rate", 1 / T, "--seconds", 0.2, "--no-page")
    for words in (deploy, (*live, *option)):
        assert (LEFT_OUT in " ".join(piezobench.run(*words).stdout.split())) == left_out
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
    piezobench: CommandLine, desk: Path, words: tuple[object, ...], reason: str
) -> None:
    before = contents(desk)
    call = piezobench(*words, folder=desk)
    assert call.status != 0
    assert reason in " ".join(call.stderr.replace("│", " ").split())
    assert contents(desk) == before
