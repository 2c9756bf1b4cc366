"""Which column is the time, the input and the output, by name, unit and values; rounding and jitter of times are no
irregularity, gaps are found, uneven times are interpolated."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recording_files import HEADER, TWO_RATES, lines_of, refusal, signals, text_file, waves, with_times

from piezo_model.operators import play
from piezo_model.recordings import Recording, RecordingError, read_reference, write_table
from piezo_model.units import split_unit


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
    cells = {time: "{0}", x: "1{1}", y: "2{1}"}
    line = ",".join(cells.get(name, "7") for name in header.split(","))
    recording = Recording.open(text_file(tmp_path, header, *(line.format(k, k % 3) for k in range(9))))
    assert recording.columns == {"time": time, "input": x, "output": y}
    assert (recording.x_range, recording.y_range) == ((10, 12), (20, 22))
    assert "guessed: time, input, output by name (override with --time, --input, --output)" in recording.describe()
    assert all(repr(name) in recording.describe() for name in (time, x, y))


def test_named_columns_are_taken_and_are_no_guesses(tmp_path: Path) -> None:
    stage = text_file(tmp_path, HEADER, *lines_of(*signals().values()))
    recording = Recording.open(stage, input="displacement_um", output="voltage_V")
    assert (recording.input_unit, recording.output_unit, recording.reasons) == ("um", "V", {"time": "by name"})
    assert "guessed: time by name (override with --time)" in recording.describe()
    assert "guessed" not in Recording.open(stage, "time_s", "voltage_V", "displacement_um").describe()


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_names_beyond_ascii_are_read_and_written(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"Prüfstand{suffix}"
    names = ["Zeit_s", "Spannung, gestellt_V", "変位_µm"]
    write_table(path, dict(zip(names, signals().values(), strict=True)))
    recording = Recording.open(path, input=names[1], output="変位_μm")  # the other of the two letters for micro
    assert (*recording.columns.values(), recording.input_unit, recording.output_unit) == (*names, "V", "um")
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
    rows = (f"{step * k:.9g},{k % 3},{k % 5}" for k in range(40))
    recording = Recording.open(text_file(tmp_path, f"{name},u,y", *rows))
    assert recording.sample_time == pytest.approx(step * seconds, rel=1e-12)
    assert ("seconds assumed" in recording.describe()) == (name == "time")


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("stamp,flag,rest,driver_a,response", ("stamp", "driver_a", "response")),
        ("n,stamp,zero,source,height_nm", ("stamp", "source", "height_nm")),
        ("t,rest,height (measured),height (piezo),segment", ("t", "height (piezo)", "height (measured)")),
        ("time,zero,Target Position,Current Position,flag", ("time", "Target Position", "Current Position")),
        ("time,zero,desired_um,actual_um,error_um", ("time", "desired_um", "actual_um")),
        ("time,zero,voltage,anything,flag", ("time", "voltage", "anything")),
        ("time,zero,anything,displacement,flag", ("time", "anything", "displacement")),
        ("time,zero,u,y_ref,y", ("time", "u", "y")),
        ("time,zero,position_V,temperature,drive_V", ("time", "drive_V", "position_V")),
    ],
)
def test_roles_are_guessed_by_elimination(tmp_path: Path, header: str, columns: tuple[str, ...]) -> None:
    t = np.arange(0, 12, 8e-3)  # three seconds at rest, a jump to -87 V, then a sine of 150 V; the sensor has an offset
    x = np.where(t < 3, 0.0, 150 * np.sin(2 * np.pi * (t - 3) - np.arcsin(87 / 150)))
    y = 0.08 * x + 0.02 * play(x, [10.0, 30.0, 60.0], np.full(3, x[0]))[0].sum(axis=1) + 213.7
    y += np.random.default_rng(0).normal(0, 0.02, t.size)
    cells = {
        "stamp": t,
        "t": t,
        "time": t,
        "n": np.arange(t.size),
        "flag": t > 5,
        "segment": t > 5,
        "rest": 0 * t,
        "zero": 0 * t + 1,
        "temperature": 20 + 0 * t,
        "error_um": x - y,
        "y_ref": np.roll(y, 3),
        columns[1]: x,
        columns[2]: y,
    }
    recording = Recording.open(text_file(tmp_path, header, *lines_of(*(cells[name] for name in header.split(",")))))
    assert tuple(recording.columns[role] for role in ("time", "input", "output")) == columns
    np.testing.assert_array_equal([recording.x, recording.y], [x, y])


PRINTED: list[tuple[float, str]] = [
    (125e-6, "{:.3f}"),
    (125e-6, "{:.4f}"),
    (125e-6, "{:.6f}"),
    (125e-6, "{!r}"),
    (0.005, "{:.3f}"),
    (0.005, "{:.2f}"),
    (1e-4, "{:.3f}"),
    (1 / 3000, "{:.3f}"),
    (1 / 3000, "{:.5f}"),
    (1e-6, "{:.9f}"),
    (0.1, "{!r}"),
]
"""Sampling periods, and the form in which their times are printed."""
K = np.arange(5000)


@pytest.mark.parametrize(
    ("times", "options", "sample_time", "rel"),
    [
        *(
            pytest.param(
                [printed.format(start + k * period) for k in range(3000)], {}, period, 1e-3, id=f"{printed} {start}"
            )
            for period, printed in PRINTED
            for start in (0.0, 17.0003, -2.0)
        ),
        pytest.param([f"{k * 125e-6:.3f}" for k in range(1000)], {}, 125e-6, 0.0, id="the round period behind"),
        pytest.param(
            [f"{0.005 * (k + 0.02 * (k == 20)):.7f}" for k in range(50)], {"time_tolerance": 0.05}, 0.005, 0.0, id="own"
        ),
        pytest.param(0.005 * (K + 0.004 * np.sin(K**2)), {}, 0.005, 1e-5, id="jitter within the tolerance"),
    ],
)
def test_rounding_of_printed_times_and_jitter_within_the_tolerance_are_no_irregularities(
    tmp_path: Path, times: list[str] | np.ndarray, options: dict[str, float], sample_time: float, rel: float
) -> None:
    recording = Recording.open(with_times(tmp_path, times), **options)  # type: ignore[arg-type]
    assert recording.sample_time == pytest.approx(sample_time, rel=rel)


def test_a_clock_of_so_few_steps_that_the_period_is_uncertain_is_refused(tmp_path: Path) -> None:
    times = [f"12:{k // 600:02d}:{k // 10 % 60:02d}" for k in range(2401)]
    assert Recording.open(with_times(tmp_path, times)).sample_time == 0.1
    assert "moves by few of its last digits; --time none" in refusal(with_times(tmp_path, times[:601]))


def test_rows_that_are_written_twice_are_dropped_where_the_last_digit_is_a_period_long(tmp_path: Path) -> None:
    rows = sorted([*range(300), *range(0, 300, 5)])
    found = Recording.open(text_file(tmp_path, HEADER, *(f"0.{k:03d},{k % 7},{k % 5}" for k in rows)))
    assert (found.sample_time, found.length) == (1e-3, 300)


@pytest.mark.parametrize(
    ("times", "sample_time"),
    [
        ({"time_s": np.cumsum(np.full(200_000, 0.005))}, 0.005),
        ({"time_s": (np.arange(100_000) * 1e-4).astype(np.float32)}, 1e-4),
        ({"time_s": np.array([float(f"{k * 125e-6:.7g}") for k in range(100_000)])}, 125e-6),
        ({"timestamp_ns": 1_700_000_000_123_456_789 + 125_000 * np.arange(5000)}, 125e-6),
        ({"timestamp_s": 1_700_000_000.1234 + 0.005 * np.arange(5000)}, 0.005),
    ],
    ids=["accumulated", "single precision", "seven digits", "ns since 1970", "s since 1970"],
)
def test_binary_times_that_rounding_alone_makes_uneven_are_uniform(
    tmp_path: Path, times: dict[str, np.ndarray], sample_time: float
) -> None:
    k = np.arange(len(next(iter(times.values()))))
    pq.write_table(pa.table({**times, "u": k % 7.0, "y": k % 5.0}), tmp_path / "s.parquet")
    assert Recording.open(tmp_path / "s.parquet").sample_time == sample_time


def test_a_gap_between_two_chunks_is_found(tmp_path: Path) -> None:
    times = signals(70_000)["time_s"] + 0.02 * (np.arange(70_000) >= 65_536)
    write_table(tmp_path / "s.parquet", {**signals(70_000), "time_s": times})
    assert "0.025 s from data row 65536 to data row 65537, where 0.005 s" in refusal(tmp_path / "s.parquet")


@pytest.mark.parametrize("period", [2e-4, 1e-3, 3.3e-4])
def test_uneven_times_are_interpolated_in_a_straight_line(tmp_path: Path, period: float) -> None:
    path = text_file(tmp_path, *waves(TWO_RATES))
    recording = Recording.open(path, resample=period)
    t, *signals = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
    even = period * np.arange(recording.length)
    assert even[-1] <= t[-1] < even[-1] + period * (1 + 1e-9)
    np.testing.assert_allclose(
        [recording.x, recording.y], [np.interp(even, t, values) for values in signals], atol=1e-12
    )
    assert recording.sample_time == period
    assert "interpolated from 500 rows at the times of the file" in recording.describe()


def test_a_reference_at_uneven_times_is_interpolated_too(tmp_path: Path) -> None:
    reference = read_reference(text_file(tmp_path, *waves(TWO_RATES, "time_s,voltage_V,reference_um")), resample=1e-3)
    assert (reference.values.size, reference.sample_time) == (260, 1e-3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"resample": 1e-3, "sample_time": 1e-3}, "give one of the two"),
        ({"resample": -1.0}, "resample must be a sampling period from"),
        ({"sample_time": "fast"}, "sample_time must be a sampling period from 1e-09 to 1e.09 s, not 'fast'"),
        ({"input_unit": " "}, "input_unit must be the name of a unit, not ' '"),
        ({"time_tolerance": 0}, "between 0 and 0.5, not 0"),
        ({"header_row": 1.5}, "header_row must be the number of a row, or 0 for no header, not 1.5"),
        ({"decimate": "2"}, "decimate must be a whole number of at least 1, not '2'"),
        ({"from_s": 3, "to_s": 2.5}, "--from 3 must be before --to 2.5"),
        ({"from_s": "3"}, "from_s must be a time in seconds, not '3'"),
        ({"header_row": 50}, "holds no data rows, or no names in row 50; --header-row says"),
        ({"table": 7}, "has no tables 7; --table"),
        ({"time": 7}, "has no column '7' for the time"),
    ],
)
def test_impossible_options_are_refused(tmp_path: Path, options: dict[str, Any], words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        Recording.open(text_file(tmp_path, *waves(TWO_RATES)), **options)


@pytest.mark.parametrize(
    ("options", "taken"),
    [
        ({"sample_time": 1e-3}, (1e-3, "", "um")),
        ({"sample_time": 1e-2, "time": "none"}, (1e-2, "", "um")),
        ({"input_unit": "Volts", "output_unit": "nm"}, (1e-3, "V", "nm")),
    ],
)
def test_a_period_that_agrees_with_the_times_or_stands_in_their_place_and_units_are_taken_as_they_are_given(
    tmp_path: Path, options: dict[str, Any], taken: tuple[float, str, str]
) -> None:
    found = Recording.open(text_file(tmp_path, *waves(np.arange(500) * 1e-3, "time,drive,sensor_um")), **options)
    assert (found.sample_time, found.input_unit, found.output_unit) == taken
    assert f"{taken[1]}, output 'sensor_um' from" in found.describe()
