"""A file made to do harm is read as any other or refused in one sentence, soon: a hang ends the run of the tests."""

import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import openpyxl
import pytest
from recording_files import HEADER, refusal, text_file, waves

from piezo_model.recordings import Recording, RecordingError
from piezo_model.units import canonical

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
@pytest.mark.parametrize("takes", [external, virtual, linked])
def test_a_file_that_takes_values_from_another_one_is_refused(
    tmp_path: Path, takes: Callable[[h5py.File, Path], None], matlab: bool
) -> None:
    secret, path = tmp_path / "secret.h5", tmp_path / ("stage.mat" if matlab else "stage.h5")
    with h5py.File(secret, "w") as file:
        file["displacement"] = np.arange(N)
    with h5py.File(path, "w", userblock_size=512 * matlab) as file:
        file["time"], file["voltage"] = np.arange(N) * 1e-3, np.sin(np.arange(N))
        takes(file, secret)
    if matlab:
        with path.open("r+b") as opened:
            opened.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    assert "takes 'displacement' from another file" in refusal(path)


@pytest.mark.parametrize(
    "line",
    [
        "1" * LONG + "e,1,1",
        "1,1" + " " * LONG + "x,1",
        "12:00" + " " * LONG + "x,1,1",
        "1." * (LONG // 2) + ",1,1",
        "1,000" * (LONG // 5) + "x;1;1",
        '"' * LONG,
        "x" * LONG + "1,1,1",
    ],
    ids=["digits", "blanks", "clock", "points", "thousands", "quotes", "letters"],
)
@pytest.mark.parametrize("at", [0, 1, 20])
def test_a_cell_of_any_length_is_read_or_refused(tmp_path: Path, line: str, at: int) -> None:
    lines = waves(np.arange(40) * 1e-3)
    _read_or_refused(text_file(tmp_path, *lines[:at], line, *lines[at:]))


@pytest.mark.parametrize(
    "line",
    [
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
    ],
    ids=["period", "rate", "brackets", "remark", "blanks", "bars", "open", "power", "powers", "product"],
)
def test_a_header_of_any_length_is_read_or_refused(tmp_path: Path, line: str) -> None:
    _read_or_refused(text_file(tmp_path, line, *waves(np.arange(40) * 1e-3)[1:]))


def test_a_unit_has_exponents_of_one_digit() -> None:
    assert [canonical(unit) for unit in ("m^2", "kV/cm**2", "s^-1", "m^9^9^9", "m^10", "m**2**2")] == [
        "m**2",
        "kV/cm**2",
        "1/s",
        "",
        "",
        "",
    ]


@pytest.mark.parametrize("names", [[f"c{k}" for k in range(20_000)], ["v"] * 60_000], ids=["names", "one name"])
def test_a_table_of_tens_of_thousands_of_columns_is_refused(tmp_path: Path, names: list[str]) -> None:
    row = ",".join(["1"] * len(names))
    path = text_file(tmp_path, ",".join(names), row, row)
    assert f"has {len(names)} columns, and no recording has more than 10000" in refusal(path)


def test_as_many_columns_as_a_recording_may_have_are_no_hindrance(tmp_path: Path) -> None:
    rows = [f"{k},{k % 7},{k % 5}" + f",{k}" * 9000 for k in range(20)]
    path = text_file(tmp_path, HEADER + "".join(f",c{k}" for k in range(9000)), *rows)
    assert Recording.open(path).length == 20


def workbook(path: Path, change: Callable[[bytes], bytes]) -> Path:
    """A workbook of a table whose sheet is changed."""
    book = openpyxl.Workbook()
    for row in ["time_s", "voltage_V", "position_um"], *([k * 1e-3, k % 7, k % 5] for k in range(100)):
        book.active.append(row)
    book.save(path)
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
        (end(b" " * 300_000_000), "is compressed far more than a table of numbers is"),
        (end(b"<row><c><v>0</v></c></row>" * 2_000_000), "is compressed far more than a table of numbers is"),
        (end(b"".join(b'<row r="%d"><c r="XFD%d"><v>1</v></c></row>' % (k, k) for k in range(200, 5000))), "cells"),
    ],
    ids=["blanks", "rows", "wide rows"],
)
def test_a_workbook_that_grows_beyond_measure_is_refused(
    tmp_path: Path, change: Callable[[bytes], bytes], sentence: str
) -> None:
    assert sentence in refusal(workbook(tmp_path / "stage.xlsx", change))


def test_the_size_that_a_workbook_states_is_not_believed(tmp_path: Path) -> None:
    def wide(sheet: bytes) -> bytes:
        return re.sub(rb'<dimension ref="[^"]*"/>', b'<dimension ref="A1:XFD1048576"/>', sheet)

    assert Recording.open(workbook(tmp_path / "stage.xlsx", wide)).length == 100


def _read_or_refused(path: Path, **options: Any) -> None:
    try:
        Recording.open(path, **options)
    except RecordingError:
        refusal(path, **options)
