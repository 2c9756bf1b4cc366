"""Clocks that are not even, periods that contradict a clock, and units that the file does not say."""

from pathlib import Path

import numpy as np
import pytest
from recording_files import HEADER, refusal, text_file

from piezo_model.recordings import Recording, RecordingError, read_reference


def rows(times: np.ndarray, header: str = HEADER, folder: Path | None = None) -> Path:
    assert folder is not None
    return text_file(
        folder, header, *(f"{t:.7g},{np.sin(40 * t):.9g},{np.sin(40 * t - 0.3):.9g}" for t in times.tolist())
    )


TWO_RATES = np.concatenate([np.arange(300) * 2e-4, 0.06 + np.arange(200) * 1e-3])


def test_two_sampling_rates_are_named_with_both_periods_and_the_way_out(tmp_path: Path) -> None:
    sentence = refusal(rows(TWO_RATES, folder=tmp_path))
    assert (
        "has two sampling rates: one sample every 0.0002 s up to row 302 (data row 301) and one every 0.001 s from "
        "there on"
    ) in sentence
    assert sentence.endswith("--resample 0.0002 interpolates to an even clock")


@pytest.mark.parametrize(
    "times", [np.delete(np.arange(400) * 1e-3, slice(200, 220)), np.sort(np.random.default_rng(0).uniform(0, 0.4, 400))]
)
def test_gaps_and_jitter_are_refused_with_the_way_out(tmp_path: Path, times: np.ndarray) -> None:
    assert "interpolates to an even clock" in refusal(rows(times, folder=tmp_path))


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
        ({"resample": 1e-3, "time": "none"}, "say --sample-time or --sample-rate"),
        ({"resample": 1e3}, "gives 1 samples"),
        ({"resample": -1.0}, "the sampling period must be from"),
    ],
)
def test_a_period_that_cannot_be_meant_is_refused(tmp_path: Path, options: dict[str, object], words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        Recording.open(rows(TWO_RATES, folder=tmp_path), **options)  # type: ignore[arg-type]


def test_a_period_that_contradicts_the_time_column_is_refused_with_both_durations(tmp_path: Path) -> None:
    even = rows(np.arange(500) * 1e-3, folder=tmp_path)
    with pytest.raises(
        RecordingError,
        match=r"lasts 0.499 s by its time column 'time_s' and 4.99 s by --sample-time "
        r"0.01; leave out",
    ):
        Recording.open(even, sample_time=1e-2)
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
