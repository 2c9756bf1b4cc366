import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from programs import real_recording
from recording_files import ROWS, signals, text_file

from piezo_model.recordings import Recording, RecordingError, read_reference, write_table
from piezo_model.units import UnitError


@pytest.fixture(params=[".csv", ".parquet"])
def stage(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / f"stage{request.param}"
    write_table(path, signals())
    return path


# Good recordings.


def test_a_file_and_arrays_have_the_same_period_length_ranges_and_units(stage: Path) -> None:
    _, x, y = signals().values()
    for recording in (
        Recording.open(stage),
        Recording.from_arrays(x, y, 0.005, input_unit="V", output_unit="um"),
    ):
        assert (recording.sample_time, recording.length) == (0.005, ROWS)
        assert recording.duration_s == pytest.approx((ROWS - 1) * 0.005)
        assert (recording.x_range, recording.y_range) == ((x.min(), x.max()), (y.min(), y.max()))
        assert (recording.input_unit, recording.output_unit) == ("V", "um")
        np.testing.assert_array_equal([recording.x, recording.y], [x, y])


def test_a_part_has_its_samples_and_starts_and_the_ranges_of_the_whole(stage: Path) -> None:
    whole = replace(Recording.open(stage), starts=(0, 100, 250))
    part = whole.part(slice(50, 250))
    np.testing.assert_array_equal([part.x, part.y], [whole.x[50:250], whole.y[50:250]])
    assert (part.starts, part.length, part.x_range) == ((0, 50), 200, whole.x_range)
    assert [sweep.length for sweep in whole.sweeps()] == [100, 150, ROWS - 250]
    assert whole.head(10 * ROWS).starts == whole.starts


def test_the_real_recording_is_read_as_its_authors_describe_it() -> None:
    recording = Recording.open(real_recording())
    assert (recording.sample_time, recording.length, recording.x_range) == (0.005, 8027, (0.0, 3.6))
    assert (recording.input_unit, recording.output_unit) == ("V", "um")
    assert recording.y_range == (-123.059139, -73.635739)


# Arrays in memory.


@pytest.mark.parametrize(
    ("units", "wanted", "gains"),
    [
        (("mV", "nm"), ("V", "um"), (1e-3, 1e-3)),
        (("V", "um"), ("kV", "µm"), (1e-3, 1.0)),
        (("uV", "microns"), ("V", "μm"), (1e-6, 1.0)),
        (("V", "micrometer"), ("V", "mm"), (1.0, 1e-3)),
        (("V", "µrad"), ("V", "mrad"), (1.0, 1e-3)),
        (("V", "pm"), ("V", "m"), (1.0, 1e-12)),
        (("counts", "arcsec"), ("counts", "urad"), (1.0, np.pi / 180 / 3600 * 1e6)),
        (("", "um"), ("V", "um"), (1.0, 1.0)),
    ],
)
def test_a_recording_is_converted_to_other_units(
    stage: Path, units: tuple[str, str], wanted: tuple[str, str], gains: tuple[float, float]
) -> None:
    given = {f"{role}_unit": unit for role, unit in zip(("input", "output"), units, strict=True) if unit}
    opened = replace(Recording.open(stage, **given), **({} if units[0] else {"input_unit": ""}))
    converted = opened.in_units(*wanted)
    for role, gain in zip("xy", gains, strict=True):
        signal = getattr(converted, role)
        np.testing.assert_allclose(signal, gain * getattr(opened, role), rtol=1e-14)
        assert getattr(converted, f"{role}_range") == (signal.min(), signal.max())
    assert (converted.input_unit, converted.output_unit) == (wanted[0], wanted[1])
    again = converted.in_units(*wanted)
    assert (again.x_range, again.y_range, again.units) == (converted.x_range, converted.y_range, converted.units)
    assert bool(converted.units) == (gains != (1.0, 1.0) or "" in units)


@pytest.mark.parametrize(
    ("unit", "wanted"), [("V", "µm"), ("nm", "V"), ("counts", "V"), ("rad", "µm"), ("%", "rad"), ("LSB", "counts")]
)
def test_units_of_different_kinds_are_refused_by_name_and_the_recording_stays(unit: str, wanted: str) -> None:
    recording = Recording.from_arrays([0.0, 1.0], [0.0, 2.0], 1e-3, input_unit=unit, output_unit="um", name="a.csv")
    sentence = f"a.csv: the input is in {unit}, which cannot be converted to {wanted}; name another column"
    with pytest.raises(UnitError, match=re.escape(sentence)):
        recording.in_units(wanted, "nm")
    assert (recording.input_unit, recording.output_unit, recording.y_range) == (unit, "um", (0.0, 2.0))
    assert recording.units == ""


def test_arrays_are_copied() -> None:
    x = np.arange(5.0)
    recording = Recording.from_arrays(x, x, 1e-3)
    x[:] = -1
    np.testing.assert_array_equal(recording.x, np.arange(5.0))


@pytest.mark.parametrize(
    ("x", "y", "sample_time", "sentence"),
    [
        ([1, 2, 3], [1, 2], 1e-3, r"of one length.*\(3,\) and \(2,\)"),
        ([[1, 2]], [[1, 2]], 1e-3, "one-dimensional"),
        ([], [], 1e-3, "not empty"),
        ([1, np.nan, 3], [1, 2, 3], 1e-3, "input is missing .or NaN. in sample 1"),
        ([1, 2, 3], [1, 2, np.inf], 1e-3, "output is infinite in sample 2"),
        ([2, 2, 2], [1, 2, 3], 1e-3, "input is constant, all 3 values are 2"),
        ([1, 2, 3], [1, 2, 3], 0.0, "the sampling period must be from 1e-09 to 1e.09 s, not 0.0"),
        ([1, 2, 3], [1, 2, 3], 1e308, "the sampling period must be from"),
        ([1, 2, 3], [1e-300, 0, 0], 1e-3, "output: the range, 1e-300, is too small"),
        ([1, 2, 3], [1, 2, 3], np.nan, "the sampling period must be from 1e-09 to 1e.09 s, not nan"),
    ],
)
def test_arrays_that_are_no_recording_are_refused(x: list, y: list, sample_time: float, sentence: str) -> None:
    with pytest.raises(RecordingError, match=sentence):
        Recording.from_arrays(x, y, sample_time)


# A reference alone.


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("column", ["y_ref_um", "reference [um]", "y_um", "path_um"])
def test_a_reference_is_read_with_its_unit(tmp_path: Path, suffix: str, column: str) -> None:
    columns = {"time_ms": np.arange(5) * 5, column: np.array([0.0, 1.0, 1.0, 2.0, 0.0])}
    write_table(tmp_path / f"reference{suffix}", columns)
    reference = read_reference(tmp_path / f"reference{suffix}")
    sample_time, values, unit = reference
    assert (sample_time, unit) == (0.005, "um")
    np.testing.assert_array_equal(values, columns[column])
    assert f"reference {column!r} from 0 to 2 µm; guessed: time, reference by name" in reference.describe()


def test_the_column_of_a_reference_may_be_named(stage: Path) -> None:
    reference = read_reference(stage, column="voltage_V")
    assert (reference.unit, reference.reasons) == ("V", {"time": "by name"})
    np.testing.assert_array_equal(reference.values, signals()["voltage_V"])


def test_a_constant_reference_is_one_to_be_held(tmp_path: Path) -> None:
    path = text_file(tmp_path, "time_s,y_ref_um", "0,5", "1,5", "2,5")
    np.testing.assert_array_equal(read_reference(path).values, [5, 5, 5])


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        (("time_s,a,b", "0,1,2", "1,2,3"), "which column is the reference.*--time and --reference"),
        (("time_s,ref", "0,1", "1,"), r"'ref' is missing .or NaN. in row 3"),
        (("time_s,ref", *(f"{max(k - 1, 0)},{k}" for k in range(12))), r"stands still in row 3 \(data row 2\)"),
    ],
)
def test_a_bad_reference_is_refused(tmp_path: Path, lines: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(RecordingError, match=sentence):
        read_reference(text_file(tmp_path, *lines))
