"""``piezobench inspect``: columns, roles that are not clear, options, JSON."""

import json
from pathlib import Path

import numpy as np
import pytest

from bench.cli.app import run

T = np.arange(600) * 1e-3
LINES = [
    f"{t:.3f};{np.round(50 + 50 * np.sin(20 * t), 4)};{np.round(-3 * np.sin(20 * t - 0.3), 4)}" for t in T.tolist()
]


def test_a_file_is_described_with_its_columns_units_and_roles(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "stage.csv"
    path.write_text("\n".join(["time [s];drive [V];height [um]", *LINES]) + "\n", encoding="utf-8")
    assert run(["inspect", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "separated by semicolons, header in row 1; 600 samples over 0.599 s, one every 1 ms by 'time [s]'" in shown
    assert "input 'drive [V]' from 0.0005 to 100 V, output 'height [um]' from -3 to 3 µm" in shown
    assert [line.split()[-1] for line in shown.splitlines()[-3:]] == ["time", "input", "output"]


def test_a_file_whose_roles_are_not_clear_is_shown_with_the_question(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "stage.csv"
    path.write_text("time,a,b,c\n" + "".join(f"{k},{k % 3},{k % 5},{k % 7}\n" for k in range(50)))
    assert run(["inspect", str(path)]) == 2
    shown = capsys.readouterr()
    assert "cannot tell which column is the input and which the output" in shown.err
    assert [line.split() for line in shown.out.splitlines()[-3:]] == [
        ["2", "a", "0", "2"],
        ["3", "b", "0", "4"],
        ["4", "c", "0", "6"],
    ]


def test_options_supply_what_the_file_lacks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "stage.csv"
    path.write_text("".join(f"{line.split(';', 1)[1].replace('.', ',')}\n" for line in LINES))
    words = ["inspect", str(path), "--json", "--sample-rate", "1000", "--decimal", ",", "--header-row", "0"]
    assert run(words) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["sample_time_s"], document["samples"], document["input"], document["output"]) == (
        1e-3,
        600,
        "column 1",
        "column 2",
    )
    assert run([*words, "--sample-time", "1"]) == 2
    assert "give either a positive rate or --sample-time" in capsys.readouterr().err
