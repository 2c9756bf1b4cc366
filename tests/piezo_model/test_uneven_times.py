"""Clocks that are not even, periods that contradict a clock, and units that the file does not say."""

from pathlib import Path

import numpy as np
import pytest
from recording_files import HEADER, text_file

from piezo_model.recordings import Recording, RecordingError, read_reference


def rows(times: np.ndarray, header: str = HEADER, folder: Path | None = None) -> Path:
    assert folder is not None
    return text_file(
        folder, header, *(f"{t:.7g},{np.sin(40 * t):.9g},{np.sin(40 * t - 0.3):.9g}" for t in times.tolist())
    )


TWO_RATES = np.concatenate([np.arange(300) * 2e-4, 0.06 + np.arange(200) * 1e-3])


@pytest.mark.parametrize("size", [7, 65536])
@pytest.mark.parametrize("period", [2e-4, 1e-3, 3.3e-4])
def test_uneven_times_are_interpolated_in_a_straight_line(tmp_path: Path, period: float, size: int) -> None:
    path = rows(TWO_RATES, folder=tmp_path)
    recording = Recording.open(path, resample=period)
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    even = period * np.arange(recording.length)
    assert even[-1] <= table[-1, 0] < even[-1] + period * (1 + 1e-9)
    x, y = (np.concatenate(parts) for parts in zip(*recording.chunks(size), strict=True))
    np.testing.assert_allclose(x, np.interp(even, table[:, 0], table[:, 1]), atol=1e-12)
    np.testing.assert_allclose(y, np.interp(even, table[:, 0], table[:, 2]), atol=1e-12)
    assert recording.sample_time == period
    assert "interpolated from 500 rows at the times of the file" in recording.describe()


def test_a_reference_at_uneven_times_is_interpolated_too(tmp_path: Path) -> None:
    path = rows(TWO_RATES, "time_s,voltage_V,reference_um", tmp_path)
    found = read_reference(path, resample=1e-3)
    assert found.values.size == 260
    assert found.sample_time == 1e-3


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"resample": 1e-3, "sample_time": 1e-3}, "give one of the two"),
        ({"resample": -1.0}, "the sampling period must be from"),
    ],
)
def test_a_period_that_cannot_be_meant_is_refused(tmp_path: Path, options: dict[str, object], words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        Recording.open(rows(TWO_RATES, folder=tmp_path), **options)  # type: ignore[arg-type]


def test_a_period_that_agrees_with_the_time_column_or_stands_in_its_place_is_taken(tmp_path: Path) -> None:
    even = rows(np.arange(500) * 1e-3, folder=tmp_path)
    assert Recording.open(even, sample_time=1e-3).sample_time == 1e-3
    assert Recording.open(even, sample_time=1e-2, time="none").sample_time == 1e-2


def test_a_unit_that_is_given_is_the_one_of_the_recording(tmp_path: Path) -> None:
    path = rows(np.arange(500) * 1e-3, "time,drive,sensor_um", tmp_path)
    recording = Recording.open(path, input_unit="Volts", output_unit="nm")
    assert (recording.input_unit, recording.output_unit) == ("V", "nm")
    assert "input 'drive' from" in recording.describe()
    assert recording.describe().endswith("(otherwise --time, --input, --output)")
    with pytest.raises(RecordingError, match="the input unit must not be empty"):
        Recording.open(path, input_unit=" ")
