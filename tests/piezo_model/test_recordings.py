"""Recordings from files and arrays, their parts and units; missing, damaged and foreign files; written tables."""

import os
import re
import resource
import stat
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import contents
from programs import real_recording
from recording_files import HEADER, ROWS, refusal, signals, text_file, without_privileges

from piezo_model.recordings import Recording, RecordingError, read_reference, write_table
from piezo_model.units import UnitError


@pytest.fixture(params=[".csv", ".parquet"])
def stage(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / f"stage{request.param}"
    write_table(path, signals())
    return path


def facts(recording: Recording) -> tuple[object, ...]:
    """Period, length, ranges and units."""
    ranges, units = (recording.x_range, recording.y_range), (recording.input_unit, recording.output_unit)
    return recording.sample_time, recording.length, *ranges, *units


# Good recordings.


def test_a_file_and_arrays_have_the_same_period_length_ranges_and_units(stage: Path) -> None:
    _, x, y = signals().values()
    for recording in (
        Recording.open(stage),
        Recording.from_arrays(x, y, 0.005, input_unit="V", output_unit="um"),
    ):
        assert facts(recording) == (0.005, ROWS, (x.min(), x.max()), (y.min(), y.max()), "V", "um")
        assert recording.duration_s == pytest.approx((ROWS - 1) * 0.005)
        np.testing.assert_array_equal([recording.x, recording.y], [x, y])


def test_a_part_has_its_samples_and_starts_and_the_ranges_of_the_whole(stage: Path) -> None:
    whole = replace(Recording.open(stage), starts=(0, 100, 250))
    part = whole.part(slice(50, 250))
    np.testing.assert_array_equal([part.x, part.y], [whole.x[50:250], whole.y[50:250]])
    assert (part.starts, part.length, part.x_range) == ((0, 50), 200, whole.x_range)
    assert [part.stop - part.start for part in whole.parts] == [100, 150, ROWS - 250]
    assert whole.head(10 * ROWS).starts == whole.starts


def test_the_real_recording_is_read_as_its_authors_describe_it() -> None:
    found = facts(Recording.open(real_recording()))
    assert found == (0.005, 8027, (0.0, 3.6), (-123.059139, -73.635739), "V", "um")


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
    assert (converted.input_unit, converted.output_unit) == wanted
    np.testing.assert_equal(vars(converted.in_units(*wanted)), vars(converted))
    assert bool(converted.units) == (gains != (1.0, 1.0) or "" in units)


@pytest.mark.parametrize(
    ("unit", "wanted"),
    [("V", "µm"), ("nm", "V"), ("counts", "V"), ("rad", "µm"), ("%", "rad"), ("LSB", "counts"), ("K", "°C")],
)
def test_units_of_different_kinds_are_refused_by_name_and_the_recording_stays(unit: str, wanted: str) -> None:
    recording = Recording.from_arrays([0.0, 1.0], [0.0, 2.0], 1e-3, input_unit=unit, output_unit="um", name="a.csv")
    sentence = f"a.csv: the input is in {unit}, which cannot be converted to {wanted}; name another column"
    with pytest.raises(UnitError, match=re.escape(sentence)):
        recording.in_units(wanted, "nm")
    assert (facts(recording), recording.units) == ((1e-3, 2, (0.0, 1.0), (0.0, 2.0), unit, "um"), "")


# A reference alone.


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("column", ["y_ref_um", "reference [um]", "y_um", "path_um"])
def test_a_reference_is_read_with_its_unit(tmp_path: Path, suffix: str, column: str) -> None:
    columns = {"time_ms": np.arange(5) * 5, column: np.array([0.0, 1.0, 1.0, 2.0, 0.0])}
    write_table(tmp_path / f"reference{suffix}", columns)
    reference = read_reference(tmp_path / f"reference{suffix}")
    assert (reference.sample_time, reference.unit) == (0.005, "um")
    np.testing.assert_array_equal(reference.values, columns[column])
    assert f"reference {column!r} from 0 to 2 µm; guessed: time, reference by name" in reference.describe()


def test_the_column_of_a_reference_may_be_named(stage: Path) -> None:
    reference = read_reference(stage, column="voltage_V")
    assert (reference.unit, reference.reasons) == ("V", {"time": "by name"})
    np.testing.assert_array_equal(reference.values, signals()["voltage_V"])


@pytest.mark.parametrize(
    ("lines", "options", "values"),
    [
        (["time_s,y_ref_um", "0,5", "1,5", "2,5"], {}, [5, 5, 5]),
        ([f"{k / 7:.3f}" for k in range(40)], {"sample_time": 0.01}, [float(f"{k / 7:.3f}") for k in range(40)]),
    ],
    ids=["to be held", "one column"],
)
def test_a_reference_may_be_constant_or_one_column_of_a_given_period(
    tmp_path: Path, lines: list[str], options: dict[str, float], values: list[float]
) -> None:
    np.testing.assert_array_equal(read_reference(text_file(tmp_path, *lines), **options).values, values)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        (("time_s,a,b", "0,1,2", "1,2,3"), "which column is the reference.*name it with --reference"),
        (("time_s,ref", "0,1", "1,"), r"has 1 data row, and a recording needs two"),
        (("time_s,ref", *(f"{max(k - 1, 0)},{k}" for k in range(12))), r"0 s from row 2 .* to row 3"),
    ],
)
def test_a_bad_reference_is_refused(tmp_path: Path, lines: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(RecordingError, match=sentence):
        read_reference(text_file(tmp_path, *lines))


# Missing, damaged and foreign files.


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize(
    ("kind", "make"),
    [
        ("no such file", str),
        ("is an empty file", Path.touch),
        ("is a folder", Path.mkdir),
        ("a pipe or a device", os.mkfifo),
    ],
)
def test_a_missing_or_an_empty_file_a_folder_and_a_pipe_are_refused(
    tmp_path: Path, suffix: str, kind: str, make: Callable[[Path], object]
) -> None:
    make(tmp_path / f"stage{suffix}")
    assert kind in refusal(tmp_path / f"stage{suffix}")


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".xlsx", ".log", ""])
def test_the_content_tells_the_format_and_not_the_suffix(stage: Path, suffix: str) -> None:
    path = stage.rename(stage.parent / f"other{suffix}")
    np.testing.assert_array_equal(Recording.open(path).counted_y, signals()["displacement_um"])


@pytest.mark.parametrize(
    "spoil",
    [
        lambda content: content[:16],
        lambda content: content[: len(content) // 2],
        lambda content: content[:-8],
        lambda content: content[:4] + bytes(1996) + content[2000:],
        lambda content: content.replace(b"time_s", b"\x80ime_s"),
    ],
)
def test_a_truncated_or_damaged_parquet_file_is_refused(tmp_path: Path, spoil: Callable[[bytes], bytes]) -> None:
    path = tmp_path / "stage.parquet"
    write_table(path, signals())
    path.write_bytes(spoil(path.read_bytes()))
    assert re.search(r": is (a Parquet file|Parquet), and damaged: ", refusal(path))


# Cells that are not numbers.


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_values_that_are_not_finite_are_counted(tmp_path: Path, suffix: str) -> None:
    columns = signals(100_000)
    columns["voltage_V"][70_000::20] = np.tile([np.nan, np.inf], 750)
    path = tmp_path / f"stage{suffix}"
    pq.write_table(pa.table(columns), path) if suffix == ".parquet" else text_file(
        tmp_path, HEADER, *(f"{t:.3f},{x},{y}" for t, x, y in zip(*columns.values(), strict=True))
    )
    assert re.search(
        "column 'voltage_V' is missing in .*data row 70001.*in all 1500 of 100000 values are missing, infinite or impl",
        refusal(path),
    )


def test_a_stream_that_was_cut_before_its_first_rows_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.arrow"
    path.write_bytes(pa.schema([(name, pa.float64()) for name in ("time_s", "drive_V", "y_um")]).serialize())
    assert "has no data rows" in refusal(path)


@pytest.mark.parametrize("kind", ["int16", "uint64", "float16", "float32", "decimal"])
def test_parquet_numbers_of_any_type_are_read(tmp_path: Path, kind: str) -> None:
    values = (
        pa.array([1, 2, 3], pa.int64()).cast(pa.decimal128(30, 2))
        if kind == "decimal"
        else pa.array(np.array([1, 2, 3], kind))
    )
    pq.write_table(pa.table({"t": [0, 1, 2], "u.v": values, "y": [1.0, 2.0, 4.0]}), tmp_path / "s.parquet")
    np.testing.assert_array_equal(Recording.open(tmp_path / "s.parquet", input="u.v").x, [1, 2, 3])


@pytest.fixture(params=[".csv", ".parquet"])
def protected(request: pytest.FixtureRequest) -> Iterator[Path]:
    """A file in a folder that everybody may enter."""
    with tempfile.TemporaryDirectory() as name:
        write_table(path := Path(name) / f"stage{request.param}", signals())
        Path(name).chmod(0o755)
        yield path
        Path(name).chmod(0o755)


def test_an_unreadable_file_is_refused(protected: Path) -> None:
    protected.chmod(0)
    with without_privileges():
        assert "cannot be read: Permission denied" in refusal(protected)


@pytest.mark.parametrize(
    ("name", "columns", "sentence"),
    [
        ("drive.xlsx", {"t": [0, 1]}, r"unknown suffix '.xlsx'; a table is written as .csv or .parquet"),
        ("drive", {"t": [0, 1]}, "unknown suffix ''"),
        ("drive.csv", {}, "needs at least one column"),
        (
            "drive.csv",
            {"t": [0, 1], "u": [1]},
            r"t and u must be vectors of the same length, not of shapes \(2,\) and \(1,\)",
        ),
        ("drive.csv", {"t": [[0, 1]]}, "t must be a vector"),
        ("drive.csv", {"t": [0, 1], "u": [1, np.nan]}, r"u\[1\] is not a finite number"),
        ("drive.csv", {"t": ["a", "b"]}, "t must hold real numbers, not <U1"),
        ("absent/drive.csv", {"t": [0, 1]}, "cannot be written: No such file"),
    ],
)
def test_a_table_that_cannot_be_written_is_refused_and_leaves_nothing(
    tmp_path: Path, name: str, columns: dict, sentence: str
) -> None:
    with pytest.raises(RecordingError, match=sentence):
        write_table(tmp_path / name, columns)
    assert list(tmp_path.iterdir()) == []


def test_a_write_that_fails_halfway_leaves_the_old_file_untouched(stage: Path) -> None:
    before, (soft, hard) = contents(stage.parent), resource.getrlimit(resource.RLIMIT_FSIZE)
    columns = {name: np.random.default_rng(3).normal(size=100_000) for name in HEADER.split(",")}
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))  # like a full disk
    try:
        with pytest.raises(RecordingError, match=r"stage.*cannot be written: File too large"):
            write_table(stage, columns)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert contents(stage.parent) == before


def test_a_read_only_folder_is_refused_and_its_files_stay(protected: Path) -> None:
    before = contents(protected.parent)
    protected.chmod(0o444)
    protected.parent.chmod(0o555)
    with without_privileges(), pytest.raises(RecordingError, match=r"stage.*cannot be written: Permission denied"):
        write_table(protected, {"t": [0, 1, 2]})
    assert contents(protected.parent) == before


def test_a_written_file_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "ordinary").touch()
    write_table(tmp_path / "drive.csv", {"t": [0, 1]})
    ordinary, written = (stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("ordinary", "drive.csv"))
    assert written == ordinary


def test_writing_through_a_link_replaces_its_target(tmp_path: Path) -> None:
    (tmp_path / "real.csv").write_text("old")
    (tmp_path / "link.csv").symlink_to(tmp_path / "real.csv")
    write_table(tmp_path / "link.csv", {"t": [0, 1]})
    assert ((tmp_path / "link.csv").is_symlink(), (tmp_path / "real.csv").read_text()) == (True, "t\n0\n1\n")
