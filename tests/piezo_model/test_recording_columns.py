from pathlib import Path

import numpy as np
import pytest
from recording_files import HEADER, signals, text_file

from piezo_model.recordings import Recording, write_table
from piezo_model.units import split_unit


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    path = tmp_path / "stage.csv"
    write_table(path, signals())
    return path


@pytest.mark.parametrize(
    ("column", "stem", "unit"),
    [
        ("voltage_V", "voltage", "V"),
        ("displacement_um", "displacement", "um"),
        ("y_nm", "y", "nm"),
        ("t_ms", "t", "ms"),
        ("voltage [V]", "voltage", "V"),
        ("y(um)", "y", "um"),
        ("Weg (µm)", "Weg", "um"),
        ("Weg_μm", "Weg", "um"),
        ("U/V", "U", "V"),
        ("force [counts]", "force", "counts"),
        ("position_x", "position_x", ""),
        ("V", "V", ""),
        ("y_ref_um", "y_ref", "um"),
        ("", "", ""),
    ],
)
def test_a_unit_is_read_from_the_name(column: str, stem: str, unit: str) -> None:
    assert split_unit(column) == (stem, unit)


@pytest.mark.parametrize(
    ("header", "time", "x", "y"),
    [
        (HEADER, "time_s", "voltage_V", "displacement_um"),
        ("y,u,t", "t", "u", "y"),
        ("t,x,y", "t", "x", "y"),
        ("sensor_um,drive_V,time", "time", "drive_V", "sensor_um"),
        ("Time [s],Command (V),Position [µm]", "Time [s]", "Command (V)", "Position [µm]"),
        ("time_s,inputVoltage,measured_output", "time_s", "inputVoltage", "measured_output"),
        ("time_s,ch1_V,ch2_um", "time_s", "ch1_V", "ch2_um"),
        ("time_s,position_command_um,position_um", "time_s", "position_command_um", "position_um"),
        ("time_s,amplifier_V,position_x_um", "time_s", "amplifier_V", "position_x_um"),
        ("index,time_s,temperature,voltage_V,sensor_V", "time_s", "voltage_V", "sensor_V"),
    ],
)
def test_columns_are_guessed_from_the_header_and_reported(
    tmp_path: Path, header: str, time: str, x: str, y: str
) -> None:
    names = header.split(",")
    cells = {time: "{0}", x: "1{1}", y: "2{1}"}
    line = ",".join(cells.get(name, "7") for name in names)
    recording = Recording.open(text_file(tmp_path, header, *(line.format(k, k % 3) for k in range(9))))
    assert recording.columns == {"time": time, "input": x, "output": y}
    assert recording.swapped().columns == {"time": time, "input": y, "output": x}
    assert (recording.x_range, recording.y_range) == ((10, 12), (20, 22))
    assert "guessed: time, input, output by name (otherwise --time, --input, --output)" in recording.describe()
    assert all(repr(name) in recording.describe() for name in (time, x, y))


def test_named_columns_are_taken_and_are_no_guesses(stage: Path) -> None:
    recording = Recording.open(stage, input="displacement_um", output="voltage_V")
    assert (recording.input_unit, recording.output_unit) == ("um", "V")
    assert recording.reasons == recording.swapped().reasons == {"time": "by name"}
    assert "guessed: time by name (otherwise --time)" in recording.describe()
    assert "guessed" not in Recording.open(stage, "time_s", "voltage_V", "displacement_um").describe()


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_names_beyond_ascii_are_read_and_written(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"Prüfstand{suffix}"
    names = ["Zeit_s", "Spannung, gestellt_V", "変位_µm"]
    write_table(path, dict(zip(names, signals().values(), strict=True)))
    recording = Recording.open(path, input=names[1], output="変位_μm")  # the other of the two letters for micro
    assert list(recording.columns.values()) == names
    assert (recording.input_unit, recording.output_unit) == ("V", "um")
    np.testing.assert_array_equal(recording.counted_y, signals()["displacement_um"])


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        ("time_s", 1.0),
        ("time_ms", 1e-3),
        ("t [us]", 1e-6),
        ("t(µs)", 1e-6),
        ("time", 1.0),
        ("timestamp_ns", 1e-9),
        ("time [min]", 60.0),
        ("t (days)", 86400.0),
    ],
)
def test_times_become_seconds(tmp_path: Path, name: str, seconds: float) -> None:
    step = 125.0 if seconds < 0.1 else 5e-4
    path = text_file(tmp_path, f"{name},u,y", *(f"{step * k:.9g},{k % 3},{k % 5}" for k in range(40)))
    recording = Recording.open(path)
    assert recording.sample_time == pytest.approx(step * seconds, rel=1e-12)
    assert ("seconds are a guess" in recording.describe()) == (name == "time")
