"""Columns of numbers out of a CSV file (RFC 4180, or with semicolons or tabs), a piece at a time.

Arrow parses; only when it refuses a file is the text walked through once more, slowly, to name the first cell that is
wrong and its row as an editor shows it.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as arrow_csv

from piezo_model.recordings.pieces import BUFFER_BYTES, Matrix, RecordingError, first_line, matrix_of

HEAD_BYTES = 1 << 16
"""The header must lie within these first bytes."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


@dataclass(frozen=True)
class CsvTable:
    """A text file with a header row; see :func:`piezo_model.recordings.tables.open_table`."""

    path: Path
    columns: tuple[str, ...]
    separator: str
    encoding: str
    header_line: int
    """Line of the header, counted from 1."""

    @classmethod
    def open(cls, path: Path) -> CsvTable:
        """Find header, separator and encoding in the first bytes of the file."""
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        if head.startswith(b"PAR1"):
            raise RecordingError(f"{path}: is a Parquet file under the name of a text file; call it .parquet")
        if b"\0" in head:
            raise RecordingError(f"{path}: is not plain text; save it as CSV in UTF-8")
        encoding = _encoding(head)
        lines = re.split(r"\r\n|\r|\n", head.decode(encoding, errors="replace"))
        written = [k for k, line in enumerate(lines) if line and not line.startswith("#")]
        if not written:
            raise RecordingError(f"{path}: holds no table, only blank or comment lines")
        at = written[0]
        separator, columns = _cells(lines[at])
        if all(_is_number(cell) for cell in columns):
            # numpy.savetxt writes its header as the last comment.
            comment = _cells(lines[at - 1].lstrip("# ")) if at else ("", ())
            if len(comment[1]) != len(columns) or comment[0] != separator:
                raise RecordingError(f"{path}: row {at + 1} is numbers where a header must name the columns")
            at, columns = at - 1, comment[1]
        if len(columns) == 1:
            raise RecordingError(f"{path}: only one column, {columns[0]!r}, in row {at + 1}; columns are separated by "
                                 "comma, semicolon or tab")
        return cls(path, columns, separator, encoding, at + 1)

    def pieces(self, columns: Sequence[str]) -> Iterator[Matrix]:
        """Stream columns as arrays of shape (columns, rows)."""
        keys = [str(k) for k in range(len(self.columns))]  # names of the file may repeat or be empty
        chosen = [keys[self.columns.index(name)] for name in columns]
        try:
            # A single parsing thread is as fast on three columns and reads less ahead.
            with arrow_csv.open_csv(
                str(self.path),
                read_options=arrow_csv.ReadOptions(use_threads=False, column_names=keys, skip_rows=self.header_line,
                                                   block_size=BUFFER_BYTES),
                parse_options=arrow_csv.ParseOptions(delimiter=self.separator),
                convert_options=arrow_csv.ConvertOptions(
                    column_types=dict.fromkeys(chosen, pa.float64()), include_columns=chosen, null_values=[""],
                    check_utf8=False),
            ) as reader:
                for batch in reader:
                    yield matrix_of(batch)
        except (pa.ArrowException, OSError) as error:
            raise RecordingError(self._complaint(columns, error)) from None

    def where(self, row: int) -> str:
        """Row of the file (the line an editor shows) and data row, for a data row counted from 0."""
        for at, (line, _) in enumerate(self._rows()):
            if at == row:
                return f"row {line} (data row {row + 1})"
        return f"data row {row + 1}"

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        with self.path.open(encoding=self.encoding, errors="replace", newline="") as file:
            for _ in range(self.header_line):
                next(file)
            reader = csv.reader(file, delimiter=self.separator)
            yield from ((self.header_line + reader.line_num, row) for row in reader if row)

    def _complaint(self, columns: Sequence[str], error: Exception) -> str:
        """The sentence for the first row that cannot be read; Arrow's own where the text shows nothing wrong."""
        chosen = [(name, self.columns.index(name)) for name in columns]
        empty = True
        try:
            for data_row, (line, cells) in enumerate(self._rows(), start=1):
                empty, place = False, f"row {line} (data row {data_row})"
                if len(cells) != len(self.columns):
                    commas = self.separator == "," and len(cells) > len(self.columns) and all(
                        re.fullmatch(r"[+-]?\d+", cell.strip()) for cell in cells)
                    return (f"{self.path}: {place} has {len(cells)} columns where the header has {len(self.columns)}"
                            + ("; its numbers seem to have decimal commas, write decimal points" if commas else ""))
                for name, at in chosen:
                    cell = cells[at].strip()
                    if DECIMAL_COMMA.fullmatch(cell):
                        return (f"{self.path}: column {name!r} holds {cell!r} in {place}, a decimal comma; "
                                "write decimal points")
                    if cell and not _is_number(cell):
                        return f"{self.path}: column {name!r} holds {cell!r} in {place}, where a number is needed"
        except (csv.Error, OSError) as failure:
            error = failure
        if empty and isinstance(error, pa.ArrowException):
            return f"{self.path}: has a header and no data rows"
        return f"{self.path}: cannot be read as CSV: {first_line(error)}"


def _encoding(head: bytes) -> str:
    try:
        head.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if error.end < len(head) - 4:  # else a character cut in two at the end of the head
            return "latin-1"
    return "utf-8-sig"


def _cells(line: str) -> tuple[str, tuple[str, ...]]:
    separator = next((mark for mark in "\t;" if mark in line), ",")
    return separator, tuple(cell.strip() for cell in next(csv.reader([line], delimiter=separator), []))


def _is_number(cell: str) -> bool:
    return bool(NUMBER.fullmatch(cell.strip()) or DECIMAL_COMMA.fullmatch(cell.strip()))
