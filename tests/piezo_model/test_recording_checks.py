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
    with pytest.raises(RecordingError, match=r"between 0 and 0.5, not 0"):
        Recording.open(path, time_tolerance=0)


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
