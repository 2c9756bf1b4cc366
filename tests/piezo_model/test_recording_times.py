"""The times of a recording: rounding and jitter are no irregularity, gaps are found, uneven times are interpolated."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recording_files import TWO_RATES, refusal, signals, text_file, waves, with_times

from piezo_model.recordings import Recording, RecordingError, read_reference, write_table


@pytest.mark.parametrize(
    ("sample_time", "printed"),
    [
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
    ],
)
@pytest.mark.parametrize("start", [0.0, 17.0003, -2.0])
def test_rounding_of_printed_times_is_no_irregularity(
    tmp_path: Path, sample_time: float, printed: str, start: float
) -> None:
    path = with_times(tmp_path, [printed.format(start + k * sample_time) for k in range(3000)])
    assert Recording.open(path).sample_time == pytest.approx(sample_time, rel=1e-3)


def test_the_round_period_behind_rounded_times_is_found(tmp_path: Path) -> None:
    recording = Recording.open(with_times(tmp_path, [f"{k * 125e-6:.3f}" for k in range(1000)]))
    assert recording.sample_time == 125e-6
    assert "rounded to 1 ms" in recording.describe()


@pytest.mark.parametrize(
    ("times", "sample_time"),
    [
        ({"time_s": np.cumsum(np.full(200_000, 0.005))}, 0.005),
        ({"time_s": (np.arange(100_000) * 1e-4).astype(np.float32)}, 1e-4),
        ({"timestamp_ns": 1_700_000_000_123_456_789 + 125_000 * np.arange(5000)}, 125e-6),
        ({"timestamp_s": 1_700_000_000.1234 + 0.005 * np.arange(5000)}, 0.005),
    ],
    ids=["accumulated", "single precision", "ns since 1970", "s since 1970"],
)
def test_binary_times_that_rounding_alone_makes_uneven_are_uniform(
    tmp_path: Path, times: dict[str, np.ndarray], sample_time: float
) -> None:
    k = np.arange(len(next(iter(times.values()))))
    pq.write_table(pa.table({**times, "u": k % 7.0, "y": k % 5.0}), tmp_path / "s.parquet")
    assert Recording.open(tmp_path / "s.parquet").sample_time == sample_time


def test_a_gap_between_two_chunks_is_found(tmp_path: Path) -> None:
    columns = signals(70_000)
    columns["time_s"][65_536:] += 0.02
    write_table(tmp_path / "s.parquet", columns)
    assert "has a gap of 0.025 s before data row 65537: about 4 samples missing" in refusal(tmp_path / "s.parquet")


def test_the_tolerance_is_the_users(tmp_path: Path) -> None:
    times = np.arange(50) * 0.005
    times[20] += 0.02 * 0.005
    path = with_times(tmp_path, [f"{t:.7f}" for t in times])
    assert Recording.open(path, time_tolerance=0.05).sample_time == 0.005


def test_jitter_within_the_tolerance_is_accepted(tmp_path: Path) -> None:
    times = (np.arange(5000) + np.random.default_rng(1).uniform(-0.004, 0.004, 5000)) * 0.005
    assert Recording.open(with_times(tmp_path, times)).sample_time == pytest.approx(0.005, rel=1e-5)


def test_times_of_seven_significant_digits_are_uniform_and_a_gap_in_them_is_found(tmp_path: Path) -> None:
    columns = signals(100_000, 125e-6)
    columns["time_s"] = np.array([float(f"{t:.7g}") for t in columns["time_s"]])
    write_table(tmp_path / "s.parquet", columns)
    assert Recording.open(tmp_path / "s.parquet").sample_time == 125e-6
    columns["time_s"][-20:] += 1e-3
    write_table(tmp_path / "gap.parquet", columns)
    assert "has a gap" in refusal(tmp_path / "gap.parquet")


@pytest.mark.parametrize("period", [2e-4, 1e-3, 3.3e-4])
def test_uneven_times_are_interpolated_in_a_straight_line(tmp_path: Path, period: float) -> None:
    path = text_file(tmp_path, *waves(TWO_RATES))
    recording = Recording.open(path, resample=period)
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    even = period * np.arange(recording.length)
    assert even[-1] <= table[-1, 0] < even[-1] + period * (1 + 1e-9)
    np.testing.assert_allclose(recording.x, np.interp(even, table[:, 0], table[:, 1]), atol=1e-12)
    np.testing.assert_allclose(recording.y, np.interp(even, table[:, 0], table[:, 2]), atol=1e-12)
    assert recording.sample_time == period
    assert "interpolated from 500 rows at the times of the file" in recording.describe()


def test_a_reference_at_uneven_times_is_interpolated_too(tmp_path: Path) -> None:
    reference = read_reference(text_file(tmp_path, *waves(TWO_RATES, "time_s,voltage_V,reference_um")), resample=1e-3)
    assert (reference.values.size, reference.sample_time) == (260, 1e-3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"resample": 1e-3, "sample_time": 1e-3}, "give one of the two"),
        ({"resample": -1.0}, "the sampling period must be from"),
        ({"input_unit": " "}, "the input unit must not be empty"),
        ({"time_tolerance": 0}, "between 0 and 0.5, not 0"),
    ],
)
def test_impossible_options_are_refused(tmp_path: Path, options: dict[str, Any], words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        Recording.open(text_file(tmp_path, *waves(TWO_RATES)), **options)


def test_a_period_that_agrees_with_the_time_column_or_stands_in_its_place_is_taken(tmp_path: Path) -> None:
    even = text_file(tmp_path, *waves(np.arange(500) * 1e-3))
    assert Recording.open(even, sample_time=1e-3).sample_time == 1e-3
    assert Recording.open(even, sample_time=1e-2, time="none").sample_time == 1e-2


def test_a_unit_that_is_given_is_the_one_of_the_recording(tmp_path: Path) -> None:
    path = text_file(tmp_path, *waves(np.arange(500) * 1e-3, "time,drive,sensor_um"))
    recording = Recording.open(path, input_unit="Volts", output_unit="nm")
    assert (recording.input_unit, recording.output_unit) == ("V", "nm")
    assert "V, output 'sensor_um' from" in recording.describe()
