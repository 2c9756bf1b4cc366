"""Excel workbooks (.xlsx): the sheet with the most numbers, or the one that the user names."""

import datetime
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.recordings.chunks import RecordingError
from piezo_model.recordings.dialect import Layout, layout_of
from piezo_model.recordings.sampling_remark import sample_time_in
from piezo_model.recordings.tables import ArrayTable, ReadOptions, parsed

NAME = "an Excel workbook"
READS = ("header_row", "sheet")
DAY_US = 86400e6
MOST_CELLS = 20_000_000
LARGE, DENSEST = 10_000_000, 30
"""Bytes of a part of a workbook, and its compression beyond which it is no table: numbers are compressed ninefold."""


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file is an archive with a workbook."""
    if not (head.startswith(b"PK\x03\x04") and zipfile.is_zipfile(path)):
        return False
    with zipfile.ZipFile(path) as archive:
        return "xl/workbook.xml" in archive.namelist()


def open_table(path: Path, options: ReadOptions) -> ArrayTable:
    """Read a sheet like a text: header, units and first row are found in the same way."""
    import openpyxl

    with parsed(path, "Excel"), zipfile.ZipFile(path) as archive:
        if any(part.file_size > max(LARGE, DENSEST * part.compress_size) for part in archive.infolist()):
            raise RecordingError(f"{path}: is compressed far more than a table of numbers is")
    # Opened here, since openpyxl checks the suffix of a name. It warns of unknown styles and extensions.
    with parsed(path, "Excel"), path.open("rb") as file, warnings.catch_warnings(action="ignore"):
        book = openpyxl.load_workbook(file, read_only=True, data_only=True)
        names = [sheet.title for sheet in book.worksheets]
        if options.sheet is not None and options.sheet not in names:
            raise RecordingError(
                f"{path}: has no sheet {options.sheet!r}; its sheets are {', '.join(map(repr, names))}"
            )
        sheets = {name: _rows(path, book[name]) for name in names if options.sheet in (None, name)}
        book.close()
    tables = {name: table for name, rows in sheets.items() if (table := _layout(rows, options))}
    if not tables:
        raise RecordingError(f"{path}: is an Excel workbook without rows of numbers")
    name = max(tables, key=lambda name: len(sheets[name]) * len(tables[name][0].columns))
    layout, offset = tables[name]
    rows = [row[offset : offset + len(layout.columns)] for row in sheets[name][layout.start :]]
    while rows and not any(isinstance(cell, int | float) for cell in rows[-1]):
        rows.pop()
    stated = sample_time_in("\t".join(map(_cell, row)) for row in sheets[name][: layout.start])
    form = f"Excel, sheet {name!r}" + ("" if layout.header is None else f", header in row {layout.header + 1}")
    arrays = [_values(path, layout, k, rows, name) for k in range(len(layout.columns))]
    columns = tuple(replace(column, rows=len(rows), sample_time=stated) for column in layout.columns)
    return ArrayTable(path, form, columns, arrays)


def _rows(path: Path, sheet: Any) -> list[tuple[Any, ...]]:
    """The rows of a sheet, as long as they are, whatever the file states."""
    sheet.reset_dimensions()
    rows, cells = [], 0
    for row in sheet.iter_rows(values_only=True):
        rows.append(row)
        cells += len(row)
        if cells > MOST_CELLS:
            raise RecordingError(f"{path}: has more than {MOST_CELLS} cells in sheet {sheet.title!r}")
    return rows


def _layout(rows: list[tuple[Any, ...]], options: ReadOptions) -> tuple[Layout, int] | None:
    """The layout of a sheet as a text separated by tabs, and the number of empty columns left of the table."""
    used = [k for row in rows for k, cell in enumerate(row) if cell is not None]
    if not used:
        return None
    first, last = min(used), max(used)
    lines = [
        "\t".join(_cell(cell) for cell in (*row, *[None] * (last + 1 - len(row)))[first : last + 1])
        for row in rows[:1000]
    ]
    layout = layout_of(lines, ".", None if options.header_row is None else options.header_row - 1)
    return None if layout is None or layout.dialect.separator != "\t" else (layout, first)


def _values(path: Path, layout: Layout, at: int, rows: list[tuple[Any, ...]], sheet: str) -> NDArray[Any]:
    from openpyxl.utils.datetime import to_excel

    kind = layout.columns[at].kind
    values = np.full(len(rows), "NaT", "m8[us]") if kind == "clock" else np.full(len(rows), np.nan)
    if kind in ("number", "clock"):
        for k, row in enumerate(rows):
            try:
                if at < len(row) and row[at] not in (None, ""):
                    values[k] = round(to_excel(row[at]) * DAY_US) if kind == "clock" else float(row[at])
            except (AttributeError, TypeError, ValueError):
                raise RecordingError(
                    f"{path}: column {layout.columns[at].name!r} holds {row[at]!r} in row "
                    f"{layout.start + k + 1} of sheet {sheet!r}, where a {kind} is needed"
                ) from None
    return values


def _cell(cell: Any) -> str:
    if isinstance(cell, datetime.datetime | datetime.time | datetime.timedelta):
        return "00:00:00"  # any text that is a clock
    return "" if cell is None else str(cell).replace("\t", " ").replace("\n", " ")
