"""Excel workbooks (.xlsx): each sheet is read like a text, and may hold tables below or beside each other."""

import datetime
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from piezo_model.recordings.dialect import Dialect
from piezo_model.recordings.layout import Layout, Region, layout_of, regions_of
from piezo_model.recordings.table import Column, RecordingError, RowName, Table, check_size

DAY_US = 86400e6
SAMPLE_LINES, TABS = 1000, Dialect("\t", ".")
LEAST_COLUMNS = 3
"""Fewest columns of each of several tables beside each other."""
MOST_CELLS = 20_000_000
LARGE, DENSEST = 10_000_000, 30
"""Bytes of a part of a workbook, and its compression beyond which it is no table: numbers are compressed ninefold."""


def open_workbook(path: Path, header_row: int | None) -> list[Table]:
    """The tables of all sheets; header, units and first row are found as in a text."""
    import openpyxl

    with zipfile.ZipFile(path) as archive:
        if any(part.file_size > max(LARGE, DENSEST * part.compress_size) for part in archive.infolist()):
            raise RecordingError(f"{path}: is compressed far more than a table of numbers is")
        check_size(path, sum(part.file_size for part in archive.infolist()))
    with path.open("rb") as file:  # opened here, since openpyxl checks the suffix of a name
        book = openpyxl.load_workbook(file, read_only=True, data_only=True)
        sheets = list(_rows(path, book.worksheets))
    tables = [table for name, rows in sheets for table in _tables(path, name, rows, header_row)]
    if not tables:
        raise RecordingError(f"{path}: is an Excel workbook without rows of numbers")
    return tables


def _tables(path: Path, name: str, rows: Sequence[tuple[Any, ...]], header_row: int | None) -> Iterator[Table]:
    """The tables below each other in some columns of a sheet."""
    # many cells can refer to one long text, and each letter is looked at many times
    check_size(path, sum(100 * len(cell) for row in rows for cell in row if isinstance(cell, str)))
    lines = ["\t".join(map(_text, row)) for row in rows]
    regions = regions_of(["".join(f"{line}\n" for line in lines)], TABS) if header_row is None else [Region()]
    for region, end in zip(regions, [*(each.line for each in regions[1:]), len(rows)], strict=True):
        layout = layout_of(lines[region.line : end][: region.names + SAMPLE_LINES], ".", header_row, region.names)
        if layout is not None and layout.dialect.separator == "\t":
            yield _table(path, name, rows[region.line + layout.start : end], layout, region)


def _table(path: Path, name: str, rows: Sequence[tuple[Any, ...]], layout: Layout, region: Region) -> Table:
    count = max(k for k, row in enumerate(rows, start=1) if any(isinstance(cell, int | float) for cell in row))
    columns = tuple(replace(column, rows=count) for column in layout.columns)

    def where(row: int) -> str:
        return f"row {region.line + layout.start + row + 1} of sheet {name!r}"

    def batches(at: Sequence[int]) -> Iterator[list[Any]]:
        yield [_values(path, [row[k] for row in rows[:count]], columns[k], where) for k in at]

    header = "" if layout.header is None else f", header in row {region.line + layout.header + 1}"
    title = f"{name}: {region.title}" if region.title else name
    return Table(path, f"Excel, sheet {name!r}{header}", columns, batches, where, title=title, rows=count)


def _rows(path: Path, sheets: Sequence[Any]) -> Iterator[tuple[str, list[tuple[Any, ...]]]]:
    """Names and rows of some sheets, as long as they are, whatever the file states, without empty columns beside them;
    tables beside each other, with an empty column between, one by one."""
    cells = 0
    for sheet in sheets:
        sheet.reset_dimensions()
        rows = []
        for row in sheet.iter_rows(values_only=True):
            rows.append(row)
            cells += len(row)
            if cells > MOST_CELLS:
                raise RecordingError(f"{path}: has more than {MOST_CELLS} cells up to sheet {sheet.title!r}")
        used = sorted({k for row in rows for k, cell in enumerate(row) if cell is not None} or {0})
        gaps = [k for k, (left, right) in enumerate(pairwise(used), start=1) if right > left + 1]
        sides = [used[a:b] for a, b in pairwise([0, *gaps, len(used)])]
        for side in sides if min(map(len, sides)) >= LEAST_COLUMNS else [used]:
            first, end = side[0], side[-1] + 1
            yield sheet.title, [(*row, *[None] * (end - len(row)))[first:end] for row in rows]


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
