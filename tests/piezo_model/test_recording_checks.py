from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recording_files import refusal, signals, with_times

from piezo_model.recordings import Recording, RecordingError, write_table


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
    path = with_times(tmp_path, [f"{k * 125e-6:.3f}" for k in range(1000)])
    recording = Recording.open(path)
    assert recording.sample_time == 125e-6
    assert "rounded to 1 ms" in recording.describe()


def test_times_of_single_precision_are_uniform(tmp_path: Path) -> None:
    columns = signals(100_000, 1e-4)
    columns["time_s"] = columns["time_s"].astype(np.float32)
    pq.write_table(pa.table(columns), tmp_path / "s.parquet")
    assert Recording.open(tmp_path / "s.parquet").sample_time == pytest.approx(1e-4, rel=1e-6)


def test_accumulated_times_are_uniform_over_many_chunks(tmp_path: Path) -> None:
    columns = signals(200_000)
    columns["time_s"] = np.cumsum(np.full(200_000, 0.005))
    write_table(tmp_path / "s.parquet", columns)
    assert Recording.open(tmp_path / "s.parquet").sample_time == 0.005


@pytest.mark.parametrize("printed", ["{:.3f}", "{!r}"])
@pytest.mark.parametrize("row", [2, 26, 50])
def test_time_that_runs_backwards_is_named(tmp_path: Path, printed: str, row: int) -> None:
    times = np.arange(50) * 0.005
    times[row - 1] = times[row - 2] - 0.001
    assert f"time column 'time_s' runs backwards in row {row + 1} (data row {row})" in refusal(
        with_times(tmp_path, [printed.format(float(t)) for t in times])
    )


@pytest.mark.parametrize("row", [2, 26, 50])
def test_time_that_stands_still_is_named(tmp_path: Path, row: int) -> None:
    times = np.arange(50) * 0.005
    times[row - 1 :] -= 0.005
    assert f"stands still in row {row + 1} (data row {row})" in refusal(with_times(tmp_path, times))


def test_time_that_stands_still_longer_than_rounding_explains_is_refused(tmp_path: Path) -> None:
    times = np.arange(2000) * 125e-6
    times[1000:] -= 100 * 125e-6
    times[1000:1100] = times[999]
    sentence = refusal(with_times(tmp_path, [f"{t:.3f}" for t in times]))
    assert "is not sampled uniformly: 0.001 s from row" in sentence


def test_time_that_never_moves_is_refused(tmp_path: Path) -> None:
    assert "stands still from row 2 (data row 1) on, at 3 s" in refusal(with_times(tmp_path, ["3.0"] * 20))


@pytest.mark.parametrize("printed", ["{:.3f}", "{:.6f}", "{!r}"])
@pytest.mark.parametrize(("row", "missing"), [(2, 1), (26, 1), (26, 49), (50, 1000)])
def test_a_gap_is_named_with_its_row_and_length(tmp_path: Path, printed: str, row: int, missing: int) -> None:
    times = np.arange(50) * 0.005
    times[row - 1 :] += missing * 0.005
    sentence = refusal(with_times(tmp_path, [printed.format(float(t)) for t in times]))
    assert f"has a gap of {0.005 * (missing + 1):.9g} s before row {row + 1} (data row {row})" in sentence
    assert f"about {missing} sample" in sentence


def test_a_gap_between_two_chunks_is_found(tmp_path: Path) -> None:
    columns = signals(70_000)
    columns["time_s"][65_536:] += 0.02
    write_table(tmp_path / "s.parquet", columns)
    assert "has a gap of 0.025 s before data row 65537: about 4 samples missing" in refusal(tmp_path / "s.parquet")


def test_a_gap_behind_coarsely_printed_times_is_found(tmp_path: Path) -> None:
    times = np.arange(3000) * 125e-6
    times[2000:] += 0.01
    assert "has a gap" in refusal(with_times(tmp_path, [f"{t:.3f}" for t in times]))


@pytest.mark.parametrize("jitter", [0.02, -0.02, 0.3])
def test_an_interval_beyond_the_tolerance_is_named(tmp_path: Path, jitter: float) -> None:
    times = np.arange(50) * 0.005
    times[20] += jitter * 0.005
    sentence = refusal(with_times(tmp_path, [f"{t:.7f}" for t in times]))
    assert "is not sampled uniformly" in sentence
    assert "from row 21 (data row 20) to row 22 (data row 21), where 0.005 s is expected" in sentence


def test_the_tolerance_is_the_users(tmp_path: Path) -> None:
    times = np.arange(50) * 0.005
    times[20] += 0.02 * 0.005
    path = with_times(tmp_path, [f"{t:.7f}" for t in times])
    assert Recording.open(path, time_tolerance=0.05).sample_time == 0.005
    with pytest.raises(RecordingError, match=r"between 0 and 0.5, not 0"):
        Recording.open(path, time_tolerance=0)


def test_jitter_within_the_tolerance_is_accepted(tmp_path: Path) -> None:
    times = (np.arange(5000) + np.random.default_rng(1).uniform(-0.004, 0.004, 5000)) * 0.005
    assert Recording.open(with_times(tmp_path, times)).sample_time == pytest.approx(0.005, rel=1e-5)


def test_times_each_written_thrice_stand_still(tmp_path: Path) -> None:
    times = np.repeat(np.arange(50) * 0.00513, 3)
    assert "stands still in row 3 (data row 2), at 0 s" in refusal(with_times(tmp_path, times))


@pytest.mark.parametrize(
    ("name", "times", "sample_time"),
    [
        ("timestamp_ns", 1_700_000_000_123_456_789 + 125_000 * np.arange(5000), 125e-6),
        ("timestamp_s", 1_700_000_000.1234 + 0.005 * np.arange(5000), 0.005),
    ],
)
def test_times_since_1970_are_uniform(tmp_path: Path, name: str, times: np.ndarray, sample_time: float) -> None:
    columns = signals(5000)
    pq.write_table(pa.table({name: times, "u": columns["voltage_V"], "y": columns["time_s"]}), tmp_path / "s.parquet")
    assert Recording.open(tmp_path / "s.parquet").sample_time == sample_time


def test_irregular_steps_of_the_last_digit_are_no_rounding(tmp_path: Path) -> None:
    times = np.arange(500) * 0.005
    times[300] += 0.001
    sentence = refusal(with_times(tmp_path, [f"{t:.3f}" for t in times]))
    assert "is not sampled uniformly: 0.006 s from row 301 (data row 300)" in sentence


def test_times_of_seven_significant_digits_are_uniform_and_a_gap_in_them_is_found(tmp_path: Path) -> None:
    columns = signals(100_000, 125e-6)
    columns["time_s"] = np.array([float(f"{t:.7g}") for t in columns["time_s"]])
    write_table(tmp_path / "s.parquet", columns)
    assert Recording.open(tmp_path / "s.parquet").sample_time == 125e-6
    columns["time_s"][-20:] += 1e-3
    write_table(tmp_path / "gap.parquet", columns)
    assert "has a gap" in refusal(tmp_path / "gap.parquet")
