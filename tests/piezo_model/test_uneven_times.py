"""Uneven times, periods that contradict the times, and units that the file does not state."""

from pathlib import Path

import numpy as np
import pytest
from recording_files import TWO_RATES, text_file, waves

from piezo_model.recordings import Recording, RecordingError, read_reference


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
    ],
)
def test_impossible_options_are_refused(tmp_path: Path, options: dict[str, object], words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        Recording.open(text_file(tmp_path, *waves(TWO_RATES)), **options)  # type: ignore[arg-type]


def test_a_period_that_agrees_with_the_time_column_or_stands_in_its_place_is_taken(tmp_path: Path) -> None:
    even = text_file(tmp_path, *waves(np.arange(500) * 1e-3))
    assert Recording.open(even, sample_time=1e-3).sample_time == 1e-3
    assert Recording.open(even, sample_time=1e-2, time="none").sample_time == 1e-2


def test_a_unit_that_is_given_is_the_one_of_the_recording(tmp_path: Path) -> None:
    path = text_file(tmp_path, *waves(np.arange(500) * 1e-3, "time,drive,sensor_um"))
    recording = Recording.open(path, input_unit="Volts", output_unit="nm")
    assert (recording.input_unit, recording.output_unit) == ("V", "nm")
    assert "V, output 'sensor_um' from" in recording.describe()
