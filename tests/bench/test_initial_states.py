"""``simulate`` and ``validate`` begin with the states that ``identify`` found before its recording, and ``compensate``
where the stage is."""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import CommandLine

from piezo_model import Compensator, HysteresisCreepModel, ModelStructure, OperatorState
from piezo_model.operator_state import padded_thresholds
from piezo_model.recordings import write_table
from piezo_model.units import quantity

SAMPLE_TIME = 1e-3


@pytest.fixture(scope="module")
def desk(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A stage that had rested high and is recorded from there on, its model, and the output as a reference."""
    folder = tmp_path_factory.mktemp("desk")
    structure = ModelStructure.equidistant(4, 1, (0.0, 100.0), (0.0, 20.0), (1.0, 0.1), SAMPLE_TIME)
    truth = HysteresisCreepModel.from_weights(
        structure, [0.2, 0.15, 0.1, 0.1, 0.1, 0.8, 0.1, 0.1, 0.05, 0.03, 0.02, 0.01]
    )
    t = np.arange(12_000) * SAMPLE_TIME
    x = 50.0 + 48.0 * np.cos(2 * np.pi * 0.7 * t) * (0.5 + 0.5 * np.cos(2 * np.pi * 0.11 * t))
    settled = 0.9 + 0.8 * padded_thresholds(structure)
    y = truth.simulate(x, OperatorState(settled, np.tile(settled, len(structure.creep_rates))))
    write_table(folder / "stage.csv", {"time_s": t, "voltage_V": x, "displacement_um": y})
    write_table(folder / "wanted.csv", {"time_s": t, "reference_um": y})
    piezobench.quietly(
        "identify", "stage.csv", "--out", "model.json", "--n", 4, "--m", 1, "--creep-rates", "1,0.1", folder=folder
    )
    return folder


def column(path: Path, number: int) -> np.ndarray:
    return np.loadtxt(path, delimiter=",", skiprows=1)[:, number]


def rms_percent(found: np.ndarray, expected: np.ndarray) -> float:
    return 100.0 * float(np.sqrt(np.mean((found - expected) ** 2)) / np.ptp(expected))


def test_a_simulated_drive_has_the_error_that_identify_reports(
    piezobench: CommandLine, desk: Path, tmp_path: Path
) -> None:
    call = piezobench(
        "simulate", desk / "model.json", desk / "stage.csv", "--input", "voltage_V", "--out", tmp_path / "y.csv"
    )
    assert "The stage begins in the states that identify found before its recording." in call.stdout
    found = rms_percent(column(tmp_path / "y.csv", 2), column(desk / "stage.csv", 2))
    assert found == pytest.approx(HysteresisCreepModel.load(desk / "model.json").report["fit"]["rms_percent"], rel=1e-6)


def test_the_compensated_drive_of_the_recorded_output_is_the_recorded_drive(
    piezobench: CommandLine, desk: Path, tmp_path: Path
) -> None:
    errors, low_end = {}, HysteresisCreepModel.load(desk / "model.json").structure.x_range[0]
    for start in ("recording", "rest"):
        call = piezobench(
            "compensate", desk / "model.json", desk / "wanted.csv", "--start", start, "--out", tmp_path / "x.csv"
        )
        assert (
            "begins in the states" if start == "recording" else f"begins settled at {quantity(low_end, 'V')}."
        ) in call.stdout
        errors[start] = rms_percent(column(tmp_path / "x.csv", 1), column(desk / "stage.csv", 1))
    assert errors["recording"] < 1.0
    assert errors["rest"] > 3.0 * errors["recording"]


def test_the_command_and_python_give_the_same_drive_to_the_last_bit(
    piezobench: CommandLine, desk: Path, tmp_path: Path
) -> None:
    model, wanted = HysteresisCreepModel.load(desk / "model.json"), column(desk / "wanted.csv", 1)
    out = tmp_path / "x.csv"
    for words, drive in (
        ((), Compensator(model).run(wanted)),
        (("--x-start", 40, "--rate-limit", 100), Compensator(model, rate_limit=100.0, x_start=40.0).run(wanted)),
    ):
        call = piezobench("compensate", desk / "model.json", desk / "wanted.csv", *words, "--out", out, "--json")
        np.testing.assert_array_equal(column(out, 1), drive)
        assert json.loads(call.stdout)["x_start"] == (40.0 if words else model.structure.x_range[0])
    assert abs(drive[0] - 40.0) <= 0.1 + 1e-12


def test_a_reference_and_a_drive_at_another_rate_are_for_the_model_at_that_rate(
    piezobench: CommandLine, desk: Path, tmp_path: Path
) -> None:
    slow = HysteresisCreepModel.load(desk / "model.json").at(10 * SAMPLE_TIME)
    t, wanted = np.loadtxt(desk / "wanted.csv", delimiter=",", skiprows=1)[::10].T
    write_table(tmp_path / "wanted.csv", {"time_s": t, "reference_um": wanted})
    for words in (("compensate", "wanted.csv", "--out", "x.csv"), ("simulate", "x.csv", "--out", "y.csv")):
        piezobench.run(words[0], desk / "model.json", *words[1:], folder=tmp_path)
    x = column(tmp_path / "x.csv", 1)
    np.testing.assert_allclose(x, Compensator(slow).run(wanted), rtol=0, atol=1e-9)
    np.testing.assert_allclose(column(tmp_path / "y.csv", 2), slow.simulate(x), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("verb", "table", "guessed"),
    [("simulate", "stage.csv", "input 'voltage_V'"), ("compensate", "wanted.csv", "reference 'reference_um'")],
)
def test_the_column_that_was_guessed_is_named(
    piezobench: CommandLine, desk: Path, tmp_path: Path, verb: str, table: str, guessed: str
) -> None:
    call = piezobench.run(verb, desk / "model.json", desk / table, "--out", tmp_path / "out.csv")
    assert re.search(f"; {guessed} from .*guessed: time, {guessed.split()[0]} by name", call.stdout, re.DOTALL)


@pytest.mark.parametrize("part", ["compensator", "learning"])
def test_the_export_at_a_rate_is_that_of_the_model_at_that_rate(
    piezobench: CommandLine, desk: Path, tmp_path: Path, part: str
) -> None:
    HysteresisCreepModel.load(desk / "model.json").at(1.0 / 8000.0).save(tmp_path / "model.json")
    for model, folder, rate in ((desk / "model.json", "at", ("--rate", 8000)), ("model.json", "of", ())):
        piezobench.run("export-c", model, folder, *rate, "--part", part, "--rate-limit", 100, folder=tmp_path)
    found, expected = ((tmp_path / folder / "piezo_parameters.h").read_text() for folder in ("at", "of"))
    assert ("#define PIEZO_SAMPLE_TIME_S 0.000125" in found, found) == (True, expected)


def test_files_in_mV_and_nm_give_what_those_in_V_and_um_give_and_the_conversion_is_printed(
    piezobench: CommandLine, desk: Path, tmp_path: Path
) -> None:
    t, x, y = np.loadtxt(desk / "stage.csv", delimiter=",", skiprows=1).T
    write_table(tmp_path / "small.csv", {"time_s": t, "voltage_mV": 1e3 * x, "displacement_nm": 1e3 * y})
    write_table(tmp_path / "wanted.csv", {"time_s": t, "reference_nm": 1e3 * y})
    for name, (verb, *further), said in (
        ("y.csv", ("simulate", "small.csv", "--input", "voltage_mV"), "the input is converted from mV to V"),
        ("x.csv", ("compensate", "wanted.csv"), "the reference is converted from nm to µm"),
    ):
        call = piezobench.run(verb, desk / "model.json", *further, "--out", name, folder=tmp_path)
        assert f"{further[0]}: {said}." in call.stdout
        further = [
            str(desk / further[0].replace("small", "stage")),
            *(word.replace("_mV", "_V") for word in further[1:]),
        ]
        call = piezobench.run(verb, desk / "model.json", *further, "--out", f"expected-{name}", folder=tmp_path)
        assert "converted" not in call.stdout
        written = (pd.read_csv(tmp_path / path, comment="#") for path in (name, f"expected-{name}"))
        pd.testing.assert_frame_equal(*written, rtol=1e-6, atol=1e-6)


def test_a_model_without_initial_states_begins_at_rest_with_a_message(
    piezobench: CommandLine, desk: Path, tmp_path: Path
) -> None:
    (tmp_path / "model.json").write_text(json.dumps({**json.loads((desk / "model.json").read_text()), "start": None}))
    for model, start in (("model.json", ()), (desk / "model.json", ("--start", "rest"))):
        words = ("simulate", model, desk / "stage.csv", "--input", "voltage_V", *start, "--out", "y.csv", "--json")
        assert json.loads(piezobench.run(*words, folder=tmp_path).stdout)["start"] == "rest"
    refused = piezobench(
        "compensate", "model.json", desk / "wanted.csv", "--start", "recording", "--out", "x.csv", folder=tmp_path
    )
    assert (refused.status, (tmp_path / "x.csv").exists()) == (2, False)
    assert "the model has no states from before a recording; begin at rest" in refused.stderr


def test_a_model_without_a_report_is_validated_with_a_page(piezobench: CommandLine, desk: Path, tmp_path: Path) -> None:
    (tmp_path / "model.json").write_text(
        json.dumps({**json.loads((desk / "model.json").read_text()), "report": {}, "start": None})
    )
    piezobench.quietly(
        "validate", "model.json", desk / "stage.csv", "--input", "voltage_V", "--page", "page.html", folder=tmp_path
    )
    assert re.search("<svg|<canvas", (tmp_path / "page.html").read_text())
