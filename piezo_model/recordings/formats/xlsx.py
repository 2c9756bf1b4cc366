"""Excel workbooks (.xlsx). Each sheet is converted to tab-separated text, and may contain tables below each other."""

import datetime
import io
import zipfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from piezo_model.recordings.formats.text import Source, tables_of
from piezo_model.recordings.table import RecordingError, Table, check_size

DAY_US, DAY_0 = 86400e6, np.datetime64("1899-12-30", "us")
MOST_CELLS = 20_000_000
LARGE, DENSEST = 10_000_000, 30
"""Bytes of a member of a workbook, and its largest plausible compression: numbers are compressed ninefold."""


def open_workbook(path: Path, header_row: int | None) -> list[Table]:
    """The tables of all sheets."""
    import openpyxl

    with zipfile.ZipFile(path) as archive, path.open("rb") as file:  # since openpyxl checks the suffix of a name
        if any(member.file_size > max(LARGE, DENSEST * member.compress_size) for member in archive.infolist()):
            raise RecordingError(f"{path}: is compressed far more than a table of numbers is")
        check_size(path, sum(member.file_size for member in archive.infolist()))
        book = openpyxl.load_workbook(file, read_only=True, data_only=True)
        tables = [
            table
            for name, text in _texts(path, book.worksheets)
            for table in tables_of(Source(path, partial(io.BytesIO, text), len(text), name), header_row, None)
        ]
    if not tables:
        raise RecordingError(
            f"{path}: is an Excel workbook without rows of numbers, or in Strict Open XML; save it as an ordinary one"
        )
    return tables


def _texts(path: Path, sheets: Sequence[Any]) -> Iterator[tuple[str, bytes]]:
    """Names and texts of sheets with their true sizes, whatever the file states, without empty columns around them."""
    cells = 0
    for sheet in sheets:
        sheet.reset_dimensions()
        rows = []
        for row in sheet.iter_rows(values_only=True):
            rows.append(row)
            cells += len(row)
            if cells > MOST_CELLS:
                raise RecordingError(f"{path}: has more than {MOST_CELLS} cells up to sheet {sheet.title!r}")
        # many cells can refer to one long text, and each letter is looked at many times
        check_size(path, sum(100 * len(cell) for row in rows for cell in row if isinstance(cell, str)))
        used = {k for row in rows for k, cell in enumerate(row) if cell is not None} or {0}
        first, end = min(used), max(used) + 1
        lines = ("\t".join(map(_text, (*row, *[None] * (end - len(row)))[first:end])) for row in rows)
        yield sheet.title, "".join(f"{line}\n" for line in lines).encode()


def _text(cell: Any) -> str:
    if isinstance(cell, datetime.datetime | datetime.time | datetime.timedelta):
        from openpyxl.utils.datetime import to_excel

        return str(DAY_0 + np.timedelta64(round(to_excel(cell) * DAY_US), "us"))
    if isinstance(cell, str):  # in one line, without quotes, and no comment
        return " ".join(cell.replace('"', " ").split()).lstrip("#%!;/*")
    return "" if cell is None else str(cell)
