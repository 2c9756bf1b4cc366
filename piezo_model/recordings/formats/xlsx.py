"""Excel workbooks (.xlsx): the sheet with the most numbers, or the one that the user names."""

import datetime
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from piezo_model.recordings.layout import layout_of
from piezo_model.recordings.table import Column, RecordingError, RowName, Table, check_size

DAY_US = 86400e6
MOST_CELLS = 20_000_000
LARGE, DENSEST = 10_000_000, 30
"""Bytes of a part of a workbook, and its compression beyond which it is no table: numbers are compressed ninefold."""


def open_workbook(path: Path, header_row: int | None, sheet: str | None) -> Table:
    """The largest table of a workbook, or that of the sheet that is named, read like a text: header, units and first
    row are found in the same way."""
    import openpyxl

    with zipfile.ZipFile(path) as archive:
        if any(part.file_size > max(LARGE, DENSEST * part.compress_size) for part in archive.infolist()):
            raise RecordingError(f"{path}: is compressed far more than a table of numbers is")
        check_size(path, sum(part.file_size for part in archive.infolist()))
    with path.open("rb") as file:  # opened here, since openpyxl checks the suffix of a name
        book = openpyxl.load_workbook(file, read_only=True, data_only=True)
        names = [each.title for each in book.worksheets]
        if sheet is not None and sheet not in names:
            raise RecordingError(f"{path}: has no sheet {sheet!r}; its sheets are {', '.join(map(repr, names))}")
        sheets = _rows(path, [each for each in book.worksheets if sheet in (None, each.title)])
    found = []
    for name, rows in sheets.items():
        # many cells can refer to one long text, and each letter is looked at many times
        check_size(path, sum(100 * len(cell) for row in rows[:1000] for cell in row if isinstance(cell, str)))
        lines = ["\t".join(map(_text, row)) for row in rows[:1000]]
        layout = layout_of(lines, ".", header_row)
        if layout is not None and layout.dialect.separator == "\t":
            found.append((len(rows) * len(layout.columns), name, layout))
    if not found:
        raise RecordingError(f"{path}: is an Excel workbook without rows of numbers")
    _, name, layout = max(found, key=lambda each: each[0])
    rows = sheets[name][layout.start :]
    while rows and not any(isinstance(cell, int | float) for cell in rows[-1]):
        rows.pop()
    columns = tuple(replace(column, rows=len(rows)) for column in layout.columns)

    def where(row: int) -> str:
        return f"row {layout.start + row + 1} of sheet {name!r}"

    def batches(at: Sequence[int]) -> Iterator[list[Any]]:
        yield [_values(path, [row[k] for row in rows], columns[k], where) for k in at]

    form = f"Excel, sheet {name!r}" + ("" if layout.header is None else f", header in row {layout.header + 1}")
    return Table(path, form, columns, batches, where)


def _rows(path: Path, sheets: Sequence[Any]) -> dict[str, list[tuple[Any, ...]]]:
    """The rows of some sheets, as long as they are, whatever the file states, without empty columns beside them."""
    found, cells = {}, 0
    for sheet in sheets:
        sheet.reset_dimensions()
        rows = []
        for row in sheet.iter_rows(values_only=True):
            rows.append(row)
            cells += len(row)
            if cells > MOST_CELLS:
                raise RecordingError(f"{path}: has more than {MOST_CELLS} cells up to sheet {sheet.title!r}")
        used = {k for row in rows for k, cell in enumerate(row) if cell is not None} or {0}
        first, end = min(used), max(used) + 1
        found[sheet.title] = [(*row, *[None] * (end - len(row)))[first:end] for row in rows]
    return found


def _values(path: Path, cells: list[Any], column: Column, where: RowName) -> np.ndarray:
    """An array of a column; RecordingError for a cell that is not of its kind."""
    from openpyxl.utils.datetime import to_excel

    clock = column.kind == "clock"
    values = np.full(len(cells), "NaT", "m8[us]") if clock else np.full(len(cells), np.nan)
    for row, cell in enumerate(cells if column.kind in ("number", "clock") else ()):
        try:
            if cell not in (None, ""):
                values[row] = round(to_excel(cell) * DAY_US) if clock else float(cell)
        except (AttributeError, TypeError, ValueError):
            raise RecordingError(
                f"{path}: column {column.name!r} holds {cell!r} in {where(row)}, where a {column.kind} is needed"
            ) from None
    return values


def _text(cell: Any) -> str:
    if isinstance(cell, datetime.datetime | datetime.time | datetime.timedelta):
        return "00:00:00"  # any text that is a clock
    return "" if cell is None else str(cell).replace("\t", " ").replace("\n", " ")
