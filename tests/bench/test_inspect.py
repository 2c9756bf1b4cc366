"""``piezobench inspect`` and ``excite``; the options of reading, two files and repairs reach every verb that opens a
recording."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import CommandLine
from recording_files import text_file

from bench.cli.app import run
from piezo_model import Recording, identify, plants
from piezo_model.recordings import read_reference, write_table

T = np.arange(600) * 1e-3
LINES = [
    f"{t:.3f};{np.round(50 + 50 * np.sin(20 * t), 4)};{np.round(-3 * np.sin(20 * t - 0.3), 4)}" for t in T.tolist()
]


def test_a_file_is_described_with_its_columns_units_and_roles(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["inspect", str(text_file(tmp_path, "time [s];drive [V];height [um]", *LINES))]) == 0
    shown = capsys.readouterr().out
    assert "separated by semicolons, header in row 1; 600 samples over 0.599 s, one every 1 ms by 'time [s]'" in shown
    assert "input 'drive [V]' from 0.0005 to 100 V, output 'height [um]' from -3 to 3 µm" in shown
    assert [line.split()[-1] for line in shown.splitlines()[-3:]] == ["time", "input", "output"]


def test_a_file_whose_roles_are_not_clear_is_shown_with_the_question(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = text_file(tmp_path, "time,a,b,c", *(f"{k},{k % 3},{k % 5},{k % 7}" for k in range(50)))
    assert run(["inspect", str(path)]) == 2
    shown = capsys.readouterr()
    assert "cannot tell which column is the input and which the output" in shown.err
    assert [line.split() for line in shown.out.splitlines()[-3:]] == [
        ["2", "a", "0", "2"],
        ["3", "b", "0", "4"],
        ["4", "c", "0", "6"],
    ]


def test_options_supply_what_the_file_lacks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = text_file(tmp_path, *(line.split(";", 1)[1].replace(".", ",") for line in LINES))
    words = ["inspect", str(path), "--json", "--sample-rate", "1000", "--decimal", ",", "--header-row", "0"]
    words += ["--input", "1", "--output", "2"]
    assert run(words) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["sample_time_s"], document["samples"], document["input"], document["output"]) == (
        1e-3,
        600,
        "column 1",
        "column 2",
    )


FIT = ("--n", 3, "--m", 1, "--rates", "10")
TIME = np.arange(4000) * 1e-3
X = 75.0 + 70.0 * np.sin(2 * np.pi * 2 * TIME) * np.linspace(0.3, 1.0, TIME.size)
Y = plants.get("bouc_wen", sample_time=1e-3).run(X)


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    """One recording whole, in two files, and with faults."""
    for name, columns in {
        "whole.csv": {"time_s": TIME, "voltage_V": X, "position_um": Y},
        "u.csv": {"t": TIME, "a": X},
        "y.csv": {"t": TIME, "noise": np.cos(9 * X), "b": Y},
    }.items():
        write_table(tmp_path / name, columns)
    bad = Y.copy()
    bad[[9, 700]] = np.nan
    pd.DataFrame({"time_s": TIME, "voltage_V": X, "position_um": bad}).to_parquet(tmp_path / "bad.parquet")
    return tmp_path


def test_a_recording_in_two_files_is_inspected_identified_validated_and_raced(
    piezobench: CommandLine, desk: Path
) -> None:
    two = ("--input", "u.csv", "--output", "y.csv:b", "--input-unit", "V", "--output-unit", "um")
    shown = json.loads(piezobench("inspect", *two, "--json", folder=desk).stdout)
    assert (shown["samples"], shown["refused"], shown["guessed"]) == (
        TIME.size,
        None,
        {"time": "by name", "input": "as the only one left", "time_unit": "seconds"},
    )
    for verb in (("identify", "--out", "m.json", *FIT), ("validate", "m.json")):
        call = piezobench.run(*verb, *two, "--page", f"{verb[0]}.html", folder=desk)
        assert "u.csv and y.csv: two files" in call.stdout
    model = json.loads((desk / "m.json").read_text())
    assert model["report"]["remarks"] == ["seconds are assumed, since no unit of the times is stated"]
    assert "Seconds are assumed" in (desk / "identify.html").read_text()
    assert model["report"]["recording"] == Recording.open(desk / "whole.csv").digest()
    piezobench.run("race", *two, "--solver", "box_active_set", "--limit", 1, "--out", desk, "--name", "r", folder=desk)


def test_repairs_are_printed_stored_and_on_the_page_and_strict_refuses_them_in_every_verb(
    piezobench: CommandLine, desk: Path
) -> None:
    call = piezobench("identify", "bad.parquet", *FIT, "--out", "m.json", "--page", "page.html", folder=desk)
    remark = "column 'position_um' is missing in data row 10, data row 701: 2 of 4000 samples"
    assert remark in " ".join(call.stdout.split()), call.stderr
    assert remark in json.loads((desk / "m.json").read_text())["report"]["remarks"][0]
    assert "is missing in data row 10" in (desk / "page.html").read_text()
    race = ("race", "--recording", "bad.parquet", "--solver", "box_active_set", "--out", desk)
    for words in (
        ("identify", "bad.parquet", "--out", "n.json"),
        ("validate", "m.json", "bad.parquet"),
        ("simulate", "m.json", "bad.parquet", "--input", "position_um", "--out", "y.csv2.csv"),
        ("compensate", "m.json", "bad.parquet", "--reference", "position_um", "--out", "x.csv"),
        ("inspect", "bad.parquet"),
        race,
    ):
        call = piezobench(*words, "--strict", folder=desk)
        assert call.status != 0
        assert "without --strict it is repaired" in " ".join(call.stderr.split()), words
    assert not (desk / "n.json").exists()


def test_a_part_of_a_recording_is_identified(piezobench: CommandLine, desk: Path) -> None:
    part = ("--from", 1, "--to", 3, "--decimate", 2, "--time-unit", "s")
    call = piezobench.run("identify", "whole.csv", *part, *FIT, "--out", "m.json", folder=desk)
    for words in ("1001 samples over 2 s, one every 2 ms", "read from row 1002 (data row 1001) on, one row in 2"):
        assert words in " ".join(call.stdout.split())


def test_the_drive_stays_in_its_range_and_has_its_rate_its_holds_and_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, page = tmp_path / "drive.csv", tmp_path / "drive.html"
    assert run(["excite", "--range", "-20:100", "--rate", "500", "--out", str(out), "--page", str(page)]) == 0
    read = read_reference(out, role="input")
    assert (read.sample_time, read.values.size, read.unit) == (2e-3, 30_000, "V")
    assert read.values.min() == read.values[0] == read.values[-1] == -20.0
    assert 99.0 < read.values.max() <= 100.0
    edges = np.flatnonzero(np.diff(read.values, prepend=np.nan, append=np.nan) != 0.0)
    assert np.sort(np.diff(edges))[-2:] * read.sample_time == pytest.approx(10.0, abs=0.1)
    assert "two holds of 10 s for creep" in capsys.readouterr().out
    assert "<svg" in page.read_text() or "vega" in page.read_text()


@pytest.mark.sample(2)
@pytest.mark.parametrize("plant", plants.names())
def test_hysteresis_and_creep_of_every_plant_are_found_from_its_recording(tmp_path: Path, plant: str) -> None:
    drive = tmp_path / "drive.csv"
    assert run(["excite", "--range", "0:100", "--rate", "200", "--out", str(drive)]) == 0
    x, period = read_reference(drive, role="input").values, 5e-3
    y = plants.get(plant, x_range=(0.0, 100.0), sample_time=period).run(x)
    y += np.random.default_rng(0).normal(0.0, 1e-3 * np.ptp(y), y.size)
    write_table(tmp_path / "stage.csv", {"time_s": np.arange(x.size) * period, "drive_V": x, "position_um": y})
    model = identify(Recording.open(tmp_path / "stage.csv"))
    assert model.report["hysteresis"]
    assert model.structure.creep_rates
    assert model.report["fit"]["rms_percent"] < 1.0
    drive = model.report["drive"]
    assert all(drive[what] for what in ("hysteresis", "creep", "drift"))
    assert drive["highest_Hz"] > 0.95 * 10.0  # a twentieth of the rate is announced
    assert drive["sentence"] in model.report["sentences"]
