import os
import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recording_files import HEADER, refusal, signals, text_file

from piezo_model.recordings import Recording, write_table

# Forms of CSV.


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_comma_semicolon_and_tab_separate(tmp_path: Path, separator: str) -> None:
    path = text_file(
        tmp_path,
        *(
            line.replace(",", separator)
            for line in ("time_s,voltage_V,y_um", "0,+1.5,2e0", " 1 , .5,-2E-1", '2,"2.",3')
        ),
    )
    x, y = Recording.open(path).arrays()
    np.testing.assert_array_equal(x, [1.5, 0.5, 2.0])
    np.testing.assert_array_equal(y, [2.0, -0.2, 3.0])


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbftime_s,u_V,y_um\n0,1,2\n1,2,3\n",
        b"time_s,u_V,y_um\r\n0,1,2\r\n1,2,3\r\n",
        b"time_s,u_V,y_um\n0,1,2\n\n1,2,3\n\n",
        b"time_s,u_V,y_um\n0,1,2\n1,2,3",
        b"# made by a stage\n\n# on a day\ntime_s,u_V,y_um\n0,1,2\n1,2,3\n",
        b"# time_s,u_V,y_um\n0,1,2\n1,2,3\n",
        b"time_s,u_V,y_\xb5m\n0,1,2\n1,2,3\n",
        b'time_s,u_V,"y_um",note\n0,1,2,\xe4\n1,2,3,"so, so"\n',
    ],
    ids=["byte order mark", "Windows", "blank lines", "no last newline", "comments", "savetxt", "Latin-1", "quotes"],
)
def test_common_dialects_are_read(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "stage.csv"
    path.write_bytes(content)
    recording = Recording.open(path)
    assert recording.output_unit == "um"
    np.testing.assert_array_equal(recording.arrays(), [[1, 2], [2, 3]])


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        (
            ("t;u;y", "0.0;1.5;2.5", "0.1;1,5;2.5", "0.2;1.5;2.5"),
            "column 'u' holds '1,5' in row 3 (data row 2), a decimal comma",
        ),
        (
            ("t,u,y", "0,0,1,5,2,5", "0,1,1,5,2,5"),
            "row 2 (data row 1) has 6 columns where the header has 3; its numbers "
            "seem to have decimal commas, write decimal points",
        ),
    ],
)
def test_decimal_commas_are_called_by_their_name(tmp_path: Path, lines: tuple[str, ...], sentence: str) -> None:
    assert sentence in refusal(text_file(tmp_path, *lines))


# Files that are not what they should be.


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
        np.testing.assert_array_equal(Recording.open(path).arrays()[1], signals()["displacement_um"])


def test_what_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "stage.csv").write_bytes(bytes(range(256)) * 40)
    assert "is neither plain text nor in a known format" in refusal(tmp_path / "stage.csv")


@pytest.mark.parametrize("content", ["\n\n", "# nothing\n"])
def test_blank_text_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "stage.csv").write_text(content)
    assert "holds no table" in refusal(tmp_path / "stage.csv")


@pytest.mark.parametrize("content", [HEADER, HEADER + "\n", HEADER + "\n\n"])
def test_a_header_alone_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "stage.csv").write_text(content)
    assert "no data rows" in refusal(tmp_path / "stage.csv").replace("0 data rows", "no data rows")


def test_parquet_of_zero_rows_is_refused(tmp_path: Path) -> None:
    pq.write_table(pa.table({name: pa.array([], pa.float64()) for name in HEADER.split(",")}), tmp_path / "e.parquet")
    assert "is a Parquet file of zero rows" in refusal(tmp_path / "e.parquet")


@pytest.mark.parametrize("share", [0.01, 0.5, 0.999])
def test_truncated_parquet_is_refused(tmp_path: Path, share: float) -> None:
    path = tmp_path / "stage.parquet"
    write_table(path, signals())
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    assert "is a truncated Parquet file" in refusal(path)


def test_parquet_damaged_inside_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "stage.parquet"
    write_table(path, signals())
    content = bytearray(path.read_bytes())
    content[4:2000] = bytes(1996)
    path.write_bytes(content)
    assert "is a damaged Parquet file" in refusal(path)


def test_one_row_is_no_recording(tmp_path: Path) -> None:
    assert "has 1 data row, and a sampling period needs two" in refusal(text_file(tmp_path, HEADER, "0,1,2"))


# Cells that are no numbers.


def broken(folder: Path, row: int, column: int, cell: str, rows: int = 50) -> Path:
    """A good file but for one cell of one data row, counted from 1."""
    lines = [[f"{0.005 * k:.3f}", str(k % 7), str(k % 5)] for k in range(rows)]
    lines[row - 1][column] = cell
    return text_file(folder, HEADER, *map(",".join, lines))


@pytest.mark.parametrize(("column", "name"), list(enumerate(HEADER.split(","))))
def test_text_is_named_with_column_and_row(tmp_path: Path, column: int, name: str) -> None:
    sentence = refusal(broken(tmp_path, 17, column, "over"))
    assert f"column '{name}' holds 'over' in row 18 (data row 17), where a number is needed" in sentence


@pytest.mark.parametrize(
    ("cell", "kind"),
    [
        ("", "missing (or NaN)"),
        ("nan", "missing (or NaN)"),
        ("NaN", "missing"),
        ("inf", "infinite"),
        ("-Infinity", "infinite"),
        ("1e999", "infinite"),
    ],
)
def test_a_value_that_is_not_finite_is_named_with_column_and_row(tmp_path: Path, cell: str, kind: str) -> None:
    for column, name in enumerate(HEADER.split(",")):
        assert f"column '{name}' is {kind}" in (sentence := refusal(broken(tmp_path, 17, column, cell)))
        assert sentence.endswith("in row 18 (data row 17)")


def test_rows_are_counted_as_an_editor_does_across_blank_and_comment_lines(tmp_path: Path) -> None:
    path = text_file(tmp_path, "# stage", HEADER, "0,1,2", "", "1,2,3", "", "2,x,4")
    assert "in row 7 (data row 3)" in refusal(path)


def test_text_far_into_a_long_file_is_found(tmp_path: Path) -> None:
    assert "'x' in row 150002 (data row 150001)" in refusal(broken(tmp_path, 150_001, 2, "x", rows=150_010))


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
def test_parquet_columns_that_are_no_numbers_are_refused(tmp_path: Path, values: list) -> None:
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
    np.testing.assert_array_equal(Recording.open(tmp_path / "s.parquet", input="u.v").arrays()[0], [1, 2, 3])


@pytest.mark.parametrize(("row", "cells"), [("1,2", 2), ("1,2,3,4", 4), ("1", 1)])
def test_a_ragged_row_is_named(tmp_path: Path, row: str, cells: int) -> None:
    sentence = refusal(text_file(tmp_path, HEADER, "0,1,2", row, "2,3,3.5"))
    assert f"row 3 (data row 2) has {cells} columns where the others have 3" in sentence


@pytest.mark.parametrize(("column", "role"), [(1, "input column 'voltage_V'"), (2, "output column 'displacement_um'")])
def test_a_constant_signal_is_refused(tmp_path: Path, column: int, role: str) -> None:
    rows = [[f"{k}", f"{k % 3}", f"{k % 3}"] for k in range(10)]
    for cells in rows:
        cells[column] = "1.8"
    assert f"{role} is constant, all 10 values are 1.8" in refusal(text_file(tmp_path, HEADER, *map(",".join, rows)))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_an_unreadable_file_is_refused(suffix: str) -> None:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / f"stage{suffix}"
        write_table(path, signals())
        path.chmod(0)
        Path(name).chmod(0o755)
        superuser = os.geteuid() == 0
        if superuser:
            os.seteuid(65534)
        try:
            assert "cannot be read: Permission denied" in refusal(path)
        finally:
            if superuser:
                os.seteuid(0)


def test_a_parquet_file_whose_names_are_no_text_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / "s.parquet"
    pq.write_table(pa.table({"time_s": [0.0, 1.0, 2.0], "u": [1.0, 2.0, 3.0], "y": [1.0, 2.0, 4.0]}), path)
    path.write_bytes(path.read_bytes().replace(b"time_s", b"\x80ime_s"))
    assert "is a damaged Parquet file" in refusal(path)
