import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recording_files import HEADER, refusal, signals, text_file, without_privileges

from piezo_model.recordings import Recording, write_table

# Missing, damaged and foreign files.


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_missing_an_empty_and_a_folder_of_a_file_are_refused(tmp_path: Path, suffix: str) -> None:
    assert "no such file" in refusal(tmp_path / f"absent{suffix}")
    (tmp_path / f"empty{suffix}").touch()
    assert "is an empty file" in refusal(tmp_path / f"empty{suffix}")
    (tmp_path / f"folder{suffix}").mkdir()
    assert "is a folder" in refusal(tmp_path / f"folder{suffix}")


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".xlsx", ".log", ""])
def test_the_content_tells_the_format_and_not_the_suffix(tmp_path: Path, suffix: str) -> None:
    write_table(tmp_path / "stage.parquet", signals())
    text_file(tmp_path, HEADER, *(",".join(map(repr, row)) for row in np.column_stack([*signals().values()]).tolist()))
    for name in ("stage.parquet", "stage.csv"):
        path = (tmp_path / name).rename(tmp_path / f"other{suffix}")
        np.testing.assert_array_equal(Recording.open(path).counted_y, signals()["displacement_um"])


def test_a_binary_file_of_no_known_format_is_refused(tmp_path: Path) -> None:
    (tmp_path / "stage.csv").write_bytes(bytes(range(256)) * 40)
    assert "is neither plain text nor in a known format" in refusal(tmp_path / "stage.csv")


def test_parquet_of_zero_rows_is_refused(tmp_path: Path) -> None:
    pq.write_table(pa.table({name: pa.array([], pa.float64()) for name in HEADER.split(",")}), tmp_path / "e.parquet")
    assert "is a Parquet file of zero rows" in refusal(tmp_path / "e.parquet")


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
    assert "is a damaged Parquet file" in refusal(path)


# Cells that are not numbers.


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_values_that_are_not_finite_are_counted(tmp_path: Path, suffix: str) -> None:
    columns = signals(100_000)
    columns["voltage_V"][[70_000, 70_001, 99_999]] = np.nan, np.inf, np.nan
    path = tmp_path / f"stage{suffix}"
    pq.write_table(pa.table(columns), path) if suffix == ".parquet" else text_file(
        tmp_path, HEADER, *(f"{t:.3f},{x},{y}" for t, x, y in zip(*columns.values(), strict=True))
    )
    sentence = refusal(path)
    assert "column 'voltage_V' is missing (or NaN) in" in sentence
    assert "data row 70001" in sentence
    assert "in all 3 of 100000 values are missing, infinite or absurd" in sentence


def test_missing_values_of_parquet_are_refused(tmp_path: Path) -> None:
    pq.write_table(pa.table({"t": [0, 1, 2], "u": [1, None, 3], "y": [1.0, 2.0, 4.0]}), tmp_path / "s.parquet")
    assert "column 'u' is missing (or NaN) in data row 2" in refusal(tmp_path / "s.parquet")


@pytest.mark.parametrize("values", [["1", "2", "3"], [True, False, True]])
def test_parquet_columns_of_text_or_flags_are_refused(tmp_path: Path, values: list) -> None:
    pq.write_table(pa.table({"t": [0, 1, 2], "u": values, "y": [1.0, 2.0, 4.0]}), tmp_path / "s.parquet")
    assert "cannot tell which column is the input" in refusal(tmp_path / "s.parquet")
    assert "column 'u' holds values of type" in refusal(tmp_path / "s.parquet", input="u")


@pytest.mark.parametrize("kind", ["int16", "uint64", "float16", "float32", "decimal"])
def test_parquet_numbers_of_any_type_are_read(tmp_path: Path, kind: str) -> None:
    values = (
        pa.array([1, 2, 3], pa.int64()).cast(pa.decimal128(30, 2))
        if kind == "decimal"
        else pa.array(np.array([1, 2, 3], kind))
    )
    pq.write_table(pa.table({"t": [0, 1, 2], "u.v": values, "y": [1.0, 2.0, 4.0]}), tmp_path / "s.parquet")
    np.testing.assert_array_equal(Recording.open(tmp_path / "s.parquet", input="u.v").x, [1, 2, 3])


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_an_unreadable_file_is_refused(suffix: str) -> None:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / f"stage{suffix}"
        write_table(path, signals())
        path.chmod(0)
        Path(name).chmod(0o755)
        with without_privileges():
            assert "cannot be read: Permission denied" in refusal(path)
