"""A bad table of text is refused in one sentence that names the file, and the column, row or option; a file made to do
harm is read as any other or refused, soon: a hang ends the run of the tests."""

import math
import re
import zipfile
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from recording_files import HEADER, TWO_RATES, error_of, refusal, text_file, waves, workbook

from piezo_model.recordings import Recording
from piezo_model.units import canonical

ORDINALS = {2: "row 3 (data row 2)", 26: "row 27 (data row 26)", 50: "row 51 (data row 50)"}
EVEN = np.arange(50) * 0.005
TENTHS = [f"2024-01-31 12:00:00.{k:07d}" for k in range(3000)]
"""Of a microsecond, ten megahertz."""


def timed(times: Any, form: str = "{}") -> list[str]:
    """A table with the given times and with varying signals."""
    return [HEADER, *(f"{form.format(t)},{k % 7},{k % 5}" for k, t in enumerate(times))]


def late(row: int, by: float, times: np.ndarray = EVEN) -> list[float]:
    """Times with an offset from a row on, counted from 1."""
    return (times + by * (np.arange(times.size) >= row - 1)).tolist()


def moved(row: int, by: float) -> list[float]:
    """Times with the time of one row replaced."""
    return (EVEN + by * (np.arange(50) == row - 1)).tolist()


def spoiled(row: int, column: int, cell: str, rows: int = 50) -> list[str]:
    """A valid table with one cell replaced."""
    lines = [line.split(",") for line in timed(f"{0.005 * k:.3f}" for k in range(rows))]
    lines[row][column] = cell
    return [",".join(cells) for cells in lines]


def constant(column: int) -> list[str]:
    return [HEADER, *(",".join("1.8" if i == column else str(k % (9 - i)) for i in range(3)) for k in range(8))]


UNLIKE = [
    (("28/02/2024 23:59:59", "29/02/2024 00:00:00", "30/02/2024 00:00:01"), 4),
    (("12/01/2024 23:59:59", "13/01/2024 00:00:00", "01/14/2024 00:00:01"), 4),
    (("2024-01-31 23:59:59", "01.02.2024 00:00:00", "01.02.2024 00:00:01"), 3),
    (("2024-01-31 23:59:58", "2024-01-31 23:59:59", "00:00:00"), 4),
    (("23:59:58", "2024-01-31 23:59:59", "00:00:00"), 3),
    (("12:00:01+01:00", "12:00:02", "12:00:03+01:00"), 3),
    (("12:00:01", "12:00:02", "12:00:03Z"), 4),
    (("12:00:01+01:00", "12:00:02+99:00", "12:00:03+01:00"), 3),
    (("12:00:01", "12:00:02", "3.5"), 4),
]
REFUSED: list[tuple[list[str], dict[str, Any], str]] = [
    # files without a table
    (["", ""], {}, "holds no data rows"),
    (["# nothing"], {}, "holds no data rows"),
    ([HEADER], {}, " data rows"),
    ([HEADER, "", ""], {}, " data rows"),
    ([HEADER, "0,1,2"], {}, "has 1 data row, and a recording needs two"),
    (["1" * (1 << 20)], {}, "longer than"),
    ([*timed(range(60_000)), "7" * (3 << 20), "1,2,3"], {}, "a line is longer than"),
    *(
        ([HEADER, "0,1,2", row, "2,3,3.5"], {}, f"row 3 (data row 2) has {cells} columns where the others have 3")
        for row, cells in (("1,2", 2), ("1,2,3,4", 4), ("1", 1))
    ),
    ([HEADER, "0,1,2,remark", "1,2,3", "2,3,3.5"], {}, "row 2 (data row 1) has 4 columns where the others have 3"),
    # cells
    (
        ["t;u;y", "0.0;1.5;2.5", "0.1;1,5;2.5", "0.2;1.5;2.5"],
        {},
        "column 'u' holds '1,5' in row 3 (data row 2), where a number is needed",
    ),
    *(
        (spoiled(17, i, "over"), {}, f"column '{name}' holds 'over' in row 18 (data row 17), where a number is needed")
        for i, name in enumerate(HEADER.split(","))
    ),
    *(
        (spoiled(17, i, cell), {}, f"column '{name}' is {kind} in row 18 (data row 17)")
        for (i, name), (cell, kind) in product(
            enumerate(HEADER.split(",")[:2]),  # outputs may be missing
            (
                ("", "missing"),
                ("nan", "missing"),
                ("NaN", "missing"),
                ("inf", "infinite"),
                ("-Infinity", "infinite"),
                ("1e999", "infinite"),
            ),
        )
    ),
    (["# stage", HEADER, "0,1,2", "", "1,2,3", "", "2,x,4"], {}, "in row 7 (data row 3)"),
    (spoiled(90_001, 2, "x", 90_010), {}, "'x' in row 90002 (data row 90001)"),
    (
        ["t,u,y", "0,1,2", "1,9.91e37,3", "2,3,4"],
        {},
        "column 'u' is 9.91e+37 in row 3 (data row 2), which is too large for a measured value",
    ),
    (
        ["t,u,y", "0,1,2", "1,-1e300,3", "2,3,4"],
        {},
        "column 'u' is -1e+300 in row 3 (data row 2), which is too large for a measured value",
    ),
    (
        ["t,u,y", "0,1,2", "1,2,3", "2,True,4", "3,4,5"],
        {},
        "column 'u' holds 'True' in row 4 (data row 3), where a number is needed",
    ),
    (constant(1), {}, "input column 'voltage_V' is constant, all 8 values are 1.8"),
    (constant(2), {}, "output column 'displacement_um' is constant, all 8 values are 1.8"),
    (
        ["t;Weg_nm", *(f"{k};{989 + k if k < 11 else f'1.{k - 11:03d}'}" for k in range(50))],
        {},
        "column 'Weg_nm' holds numbers such as '1.000' and '989'; is the mark between thousands? Write them without it",
    ),
    (
        ["t;Weg_nm", *(f"{k};{f'{k % 900 + 5000 * (k > 2500):,}'.replace(',', '.')}" for k in range(3000))],
        {},
        "column 'Weg_nm' holds numbers such as '5.701' and '0'; is the mark between thousands? Write them without it",
    ),
    *(
        (
            ["t,u,y", *(f"{start + k * step:.9f},{k % 7},{k % 5}" for k in range(200))],
            {},
            "--time-unit states or confirms",
        )
        for start, step in ((45382.5, 1e-3 / 86400.0), (739000.5, 1.0 / 86400.0), (1711900000000.0, 1.0))
    ),
    # columns
    (
        ['"t\n[s]","drive\n[V]","height\n[um]"', *timed(EVEN)[1:]],
        {},
        "its columns are 'column 1', 'column 2', 'column 3'; name them with --input and --output",
    ),
    *(
        ([header, "0,1,2", "1,2,3", "2,5,5"], {}, "cannot tell which column is the")
        for header in ("time_s,a,b", "time_s,voltage_1,voltage_2", "time_s,reference_um,voltage_V")
    ),
    (["t,u,x_um,y_um", "0,1,2,9", "1,2,3,7", "2,5,5,8"], {}, "cannot tell which column is the output"),
    (["t,x_V,y_V,x_um,y_um", "0,1,2,9,1", "1,2,3,7,2", "2,5,5,8,4"], {}, "the input and which the output"),
    (
        ["time_s,a,b", "0,1,2", "1,2,3", "2,5,5"],
        {},
        "its columns are 'time_s', 'a', 'b'; name them with --input and --output",
    ),
    (
        ["u,y", "1,2", "2,3", "3,3", "4,2"],
        {},
        "cannot tell which column is the time; its columns are 'u', 'y'; name it with --time, or give --sample-time or "
        "--sample-rate",
    ),
    (["index,u,y", "1,1,2", "2,2,3", "3,3,3", "4,2,2"], {}, "cannot tell which column is the time"),
    (
        [f"{t:.3f},{math.sin(t)!r},{2 * math.sin(t)!r}" for t in (np.arange(500) * 1e-3).tolist()],
        {},
        "cannot tell which column is the input and which the output; its columns are 'column 1', 'column 2', "
        "'column 3'; name them with --input and --output",
    ),
    (
        timed(EVEN),
        {"input": "volts"},
        "no column 'volts' for the input; its columns are 'time_s', 'voltage_V', 'displacement_um'",
    ),
    (timed(EVEN), {"input": "voltage_V", "output": "voltage_V"}, "one column cannot serve"),
    (["t,u,y,y", "0,1,2,3", "1,2,3,4"], {}, "cannot tell which column is the output"),
    (["t,u,y,y", "0,1,2,3", "1,2,3,4"], {"output": "y"}, "2 columns named 'y'"),
    (
        ["time [furlong],u,y", "0,1,2", "1,2,3"],
        {},
        "time column 'time [furlong]' is in 'fur', which is not a unit of time",
    ),
    (
        ["[step]", *timed(EVEN), "[sine]", *timed(EVEN)],
        {},
        "has 2 tables, and the columns of 2 look like a recording; --table takes a number or a name: 1 'step' "
        f"(time_s, voltage_V, displacement_um; {len(EVEN)} rows); 2 'sine' (",
    ),
    ([*timed(EVEN), *["0.5,1"] * 9], {}, f"data row {len(EVEN) + 1}) has 2 columns where the others have 3"),
    (timed(EVEN), {"table": "Messung 1"}, "has no tables 'Messung 1'; --table takes a number or a name: 1 '' ("),
    (
        timed(EVEN),
        {"time": "1", "sample_time": 0.01},
        "has one sample every 0.005 s, and --sample-time or --sample-rate says 0.01 s; omit it, or give --time none",
    ),
    # times
    (
        ["t,u,y", "0,1,2", "1e-307,2,3", "2e-307,3,4"],
        {},
        "column 't': the sampling period must be from 1e-09 to 1e+09 s, not 1e-307",
    ),
    (
        ["t,u,y", "12:00:01,1,2", "12:00:02,2,3", "noon,3,4", "12:00:04,3,4"],
        {},
        "column 't' holds 'noon' in row 4 (data row 3), where a clock like '12:00:01' is needed",
    ),
    *(
        (
            timed([*cells, *cells[:1] * 20]),
            {},
            f"column 'time_s' holds {cells[row - 2]!r} in row {row} (data row {row - 1}), where a clock like "
            f"{cells[0]!r} is needed",
        )
        for cells, row in UNLIKE
    ),
    (
        timed(f"31.02.2024 12:00:{k:02d}" for k in range(60)),
        {},
        "column 'time_s' holds '31.02.2024 12:00:00' in row 2 (data row 1), where a clock is needed",
    ),
    (
        timed(TENTHS[:1000] + TENTHS[1001:]),
        {},
        "2e-07 s from row 1001 (data row 1000) to row 1002 (data row 1001), where 1e-07 s is expected",
    ),
    *(
        (timed(moved(row, -0.006), form), {}, f"time column 'time_s' runs backwards in {place}")
        for (row, place), form in product(ORDINALS.items(), ("{:.3f}", "{!r}"))
    ),
    *(
        (timed(late(row, -0.005)), {}, f" 0 s from row {row} (data row {row - 1}) to {place}, where 0.005 s")
        for row, place in ORDINALS.items()
    ),
    (
        timed([*(np.arange(1000) * 125e-6), *[999 * 125e-6] * 100, *(np.arange(1000, 1900) * 125e-6)], "{:.3f}"),
        {},
        "is not sampled uniformly: 0.001 s from row",
    ),
    (timed(["3.0"] * 20), {}, "stands still from row 2 (data row 1) on, at 3 s"),
    (timed(["23:59:59"] * 80 + ["00:00:00"] * 320), {}, "or moves by few of its last digits; --time none and --sample"),
    (timed(np.repeat(np.arange(50) * 0.00513, 3)), {}, "0 s from row 2 (data row 1) to row 3 (data row 2)"),
    *(
        (
            timed(late(row, missing * 0.005), form),
            {},
            f" {0.005 * (missing + 1):.9g} s from row {row} (data row {row - 1}) to {ORDINALS[row]}, where 0.005",
        )
        for (row, missing), form in product(((2, 1), (26, 1), (26, 8), (50, 1000)), ("{:.3f}", "{:.6f}", "{!r}"))
    ),
    (timed(late(2001, 0.01, np.arange(3000) * 125e-6), "{:.3f}"), {}, "is not sampled uniformly"),
    *((timed(moved(21, by * 0.005), "{:.7f}"), {}, "is not sampled uniformly") for by in (0.02, -0.02, 0.3)),
    *(
        (
            timed(moved(21, by * 0.005), "{:.7f}"),
            {},
            "from row 21 (data row 20) to row 22 (data row 21), where 0.005 s is expected",
        )
        for by in (0.02, -0.02, 0.3)
    ),
    (
        timed(moved(31, 0.001), "{:.3f}"),
        {},
        "is not sampled uniformly: 0.006 s from row 31 (data row 30)",
    ),
    (
        waves(TWO_RATES),
        {},
        "has two sampling rates: one sample every 0.0002 s at its start and one every 0.001 s at its end",
    ),
    (waves(TWO_RATES), {}, "--resample 0.0002 interpolates to an even clock"),
    (waves(np.delete(np.arange(400) * 1e-3, slice(200, 208))), {}, "interpolates to an even clock"),
    (waves(np.sort(np.random.default_rng(0).uniform(0, 0.4, 400))), {}, "interpolates to an even clock"),
    (waves(TWO_RATES), {"resample": 1e-3, "time": "none"}, "give --sample-time or --sample-rate"),
    (waves(TWO_RATES), {"resample": 1e3}, "makes 1 samples of 500 rows"),
    # comments, headers and blank lines among the rows, which shift no row that is named
    (
        ["t;u;y", "0;1;2", "# pause", "t;u;y", "1;2;3", "", "2;x;4"],
        {},
        "holds 'x' in row 7 (data row 3), where a number is needed",
    ),
    (
        ["t;u;y", "0;1;2", "# pause", "1;2;3", "; second", "2;3;4"],
        {},
        "row 5 (data row 3) has 2 columns where the others have 3",
    ),
    (["t u y", "0 1 2", "\t", "1 2 3", "2 x 4"], {}, "holds 'x' in row 5 (data row 3), where a number is needed"),
    # tens of thousands of columns
    *(
        ([",".join(names), *2 * [",".join(["1"] * len(names))]], {}, f"has {len(names)} columns, more than the limit")
        for names in ([f"c{k}" for k in range(20_000)], ["v"] * 60_000)
    ),
]


@pytest.mark.parametrize(("lines", "options", "sentence"), REFUSED, ids=range(len(REFUSED)))
def test_a_bad_table_is_refused_with_the_row_column_or_option(
    tmp_path: Path, lines: list[str], options: dict[str, Any], sentence: str
) -> None:
    assert sentence in refusal(text_file(tmp_path, *lines), **options)


N = 1000
LONG = 200_000
"""Characters of a cell; an expression that tries every pair of places in it takes hours."""


def external(file: h5py.File, secret: Path) -> None:
    file.create_dataset("displacement", (N,), dtype="f8", external=[(str(secret), 0, 8 * N)])


def virtual(file: h5py.File, secret: Path) -> None:
    layout = h5py.VirtualLayout(shape=(N,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(secret), "displacement", shape=(N,))
    file.create_virtual_dataset("displacement", layout)


def linked(file: h5py.File, secret: Path) -> None:
    file["displacement"] = h5py.ExternalLink(str(secret), "displacement")


@pytest.mark.parametrize("matlab", [False, True], ids=["HDF5", "MATLAB 7.3"])
@pytest.mark.parametrize(
    ("takes", "sentence"),
    [
        (external, "'displacement' links to another file"),
        (virtual, "'displacement' links to another file"),
        (linked, "which column is the output; its columns are 'time', 'voltage'"),
    ],
)
def test_values_in_another_file_are_not_read(
    tmp_path: Path, takes: Callable[[h5py.File, Path], None], sentence: str, matlab: bool
) -> None:
    secret, path = tmp_path / "secret.h5", tmp_path / ("stage.mat" if matlab else "stage.h5")
    with h5py.File(secret, "w") as file:
        file["displacement"] = np.arange(N)
    with h5py.File(path, "w", userblock_size=512 * matlab) as file:
        file["time"], file["voltage"] = np.arange(N) * 1e-3, np.sin(np.arange(N))
        takes(file, secret)
    if matlab:
        path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + path.read_bytes()[128:])
    assert sentence in refusal(path)


LINES = waves(np.arange(40) * 1e-3)
CELLS = (
    "1" * LONG + "e,1,1",
    "1,1" + " " * LONG + "x,1",
    "12:00" + " " * LONG + "x,1,1",
    "1." * (LONG // 2) + ",1,1",
    "1,000" * (LONG // 5) + "x;1;1",
    '"' * LONG,
    "x" * LONG + "1,1,1",
)
HEADERS = (
    "dt" + " " * LONG + "x",
    "sampl" + "_" * LONG,
    "dt [" * (LONG // 4),
    "# " + "x" * LONG,
    "time_s,a" + " " * LONG + "!,b",
    "time_s,a" + "_" * LONG + "!,b",
    "time_s," + "[" * LONG + ",b",
    "time_s,voltage (m^9^9^9),b",
    "time_s,voltage (m**9**9**9),b",
    "time_s,voltage (" + "m*" * LONG + "m),b",
)


@pytest.mark.parametrize(
    "lines",
    [
        *([*LINES[:at], cell, *LINES[at:]] for cell, at in product(CELLS, (0, 1, 20))),
        *([header, *LINES[1:]] for header in HEADERS),
    ],
    ids=range(3 * len(CELLS) + len(HEADERS)),
)
def test_a_cell_or_a_header_of_any_length_is_read_or_refused(tmp_path: Path, lines: list[str]) -> None:
    path = text_file(tmp_path, *lines)
    if error_of(path):
        refusal(path)


def test_a_unit_has_exponents_of_one_digit() -> None:
    assert [canonical(unit) for unit in ("m^2", "kV/cm**2", "s^-1", "m^9^9^9", "m^10", "m**2**2")] == [
        "m**2",
        "kV/cm**2",
        "1/s",
        "",
        "",
        "",
    ]


def test_as_many_columns_as_a_recording_may_have_are_no_hindrance(tmp_path: Path) -> None:
    rows = [f"{k},{k % 7},{k % 5}" + f",{k}" * 9000 for k in range(20)]
    assert Recording.open(text_file(tmp_path, HEADER + "".join(f",c{k}" for k in range(9000)), *rows)).length == 20


def changed_workbook(path: Path, change: Callable[[bytes], bytes]) -> Path:
    """A workbook of a table whose sheet is changed."""
    workbook(path, HEADER.split(","), *([k * 1e-3, k % 7, k % 5] for k in range(100)))
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, part in parts.items():
            archive.writestr(name, change(part) if name == "xl/worksheets/sheet1.xml" else part)
    return path


def end(rows: bytes) -> Callable[[bytes], bytes]:
    """Append rows to a sheet."""
    return lambda sheet: sheet.replace(b"</sheetData>", rows + b"</sheetData>")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (end(b" " * 30_000_000), "is compressed far more than a table of numbers is"),
        (end(b"<row><c><v>0</v></c></row>" * 500_000), "is compressed far more than a table of numbers is"),
        (end(b"".join(b'<row r="%d"><c r="XFD%d"><v>1</v></c></row>' % (k, k) for k in range(200, 5000))), "cells"),
    ],
    ids=["blanks", "rows", "wide rows"],
)
def test_a_workbook_that_grows_beyond_measure_is_refused(
    tmp_path: Path, change: Callable[[bytes], bytes], sentence: str
) -> None:
    assert sentence in refusal(changed_workbook(tmp_path / "stage.xlsx", change))


def test_the_cells_of_all_sheets_are_counted(tmp_path: Path) -> None:
    book = workbook(tmp_path / "stage.xlsx")
    for sheet in (book.active, book.create_sheet(), book.create_sheet()):
        for row in range(1, 451):
            sheet.cell(row, 16384, row)
    book.save(tmp_path / "stage.xlsx")
    assert "has more than 20000000 cells up to sheet 'Sheet2'" in refusal(tmp_path / "stage.xlsx")


def test_the_size_that_a_workbook_states_is_not_believed(tmp_path: Path) -> None:
    stated = b'<dimension ref="A1:XFD1048576"/>'
    path = changed_workbook(tmp_path / "stage.xlsx", lambda sheet: re.sub(rb'<dimension ref="[^"]*"/>', stated, sheet))
    assert Recording.open(path).length == 100
