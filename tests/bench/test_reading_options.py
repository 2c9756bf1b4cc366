"""The options of reading, two files and repairs reach every verb that opens a recording."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import CommandLine

from piezo_model import Recording, plants
from piezo_model.recordings import write_table

FIT = ("--n", 3, "--m", 1, "--rates", "10")
T = np.arange(4000) * 1e-3
X = 75.0 + 70.0 * np.sin(2 * np.pi * 2 * T) * np.linspace(0.3, 1.0, T.size)
Y = plants.get("bouc_wen", sample_time=1e-3).run(X)


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    """One recording whole, in two files, and with faults."""
    for name, columns in {
        "whole.csv": {"time_s": T, "voltage_V": X, "position_um": Y},
        "u.csv": {"t": T, "a": X},
        "y.csv": {"t": T, "noise": np.cos(9 * X), "b": Y},
    }.items():
        write_table(tmp_path / name, columns)
    bad = Y.copy()
    bad[[9, 700]] = np.nan
    pd.DataFrame({"time_s": T, "voltage_V": X, "position_um": bad}).to_parquet(tmp_path / "bad.parquet")
    return tmp_path


def test_a_recording_in_two_files_is_inspected_identified_validated_and_raced(
    piezobench: CommandLine, desk: Path
) -> None:
    two = ("--input", "u.csv", "--output", "y.csv:b", "--input-unit", "V", "--output-unit", "um")
    shown = json.loads(piezobench("inspect", *two, "--json", folder=desk).stdout)
    assert (shown["samples"], shown["refused"], shown["guessed"]) == (
        T.size,
        None,
        {"time": "by name", "input": "as the only one left", "time_unit": "seconds"},
    )
    for verb in (("identify", "--out", "m.json", *FIT), ("validate", "m.json")):
        call = piezobench.run(*verb, *two, "--page", f"{verb[0]}.html", folder=desk)
        assert "u.csv and y.csv: two files" in call.stdout
    model = json.loads((desk / "m.json").read_text())
    assert model["report"]["remarks"] == ["seconds are a guess, since nobody states the unit of the times"]
    assert "Seconds are a guess" in (desk / "identify.html").read_text()
    assert model["report"]["recording"] == Recording.open(desk / "whole.csv").digest()
    piezobench.run("race", *two, "--solver", "box_active_set", "--limit", 1, "--out", desk, "--name", "r", folder=desk)
    assert (
        "Missing argument 'recording', or --input FILE and --output FILE" in piezobench("inspect", folder=desk).stderr
    )


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
        assert "without --strict that is repaired" in " ".join(call.stderr.split()), words
    assert not (desk / "n.json").exists()


def test_a_part_of_a_recording_is_identified(piezobench: CommandLine, desk: Path) -> None:
    part = ("--from", 1, "--to", 3, "--decimate", 2, "--time-unit", "s")
    call = piezobench.run("identify", "whole.csv", *part, *FIT, "--out", "m.json", folder=desk)
    assert "1001 samples over 2 s, one every 2 ms" in call.stdout
    assert "read from row 1002 (data row 1001) on, one row in 2" in " ".join(call.stdout.split())
