"""A table of numbers in a CSV or Parquet file.

A table is a path, its column names and two verbs: ``pieces(columns)`` streams the named columns as float64 arrays of
shape (columns, rows) in memory that does not grow with the file, and ``where(row)`` says in the user's own count where
a row is. A missing cell arrives as NaN; what NaN means is judged in :mod:`piezo_model.recordings.checks`.

Formats: RFC 4180 for CSV (:mod:`piezo_model.recordings.csv_table`); Apache Parquet.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as arrow_parquet

from piezo_model.recordings.csv_table import CsvTable
from piezo_model.recordings.pieces import BUFFER_BYTES, Matrix, RecordingError, first_line, matrix_of

CSV_SUFFIXES = (".csv", ".tsv", ".txt", ".dat")
PARQUET_SUFFIXES = (".parquet", ".pq")


@dataclass(frozen=True)
class ParquetTable:
    """A Parquet file; see :func:`open_table`."""

    path: Path
    columns: tuple[str, ...]

    @classmethod
    def open(cls, path: Path) -> ParquetTable:
        """Read the column names from the footer."""
        with path.open("rb") as file:
            head = file.read(4)
            file.seek(-min(4, path.stat().st_size), io.SEEK_END)
            tail = file.read(4)
        if head != b"PAR1":
            raise RecordingError(f"{path}: is not a Parquet file, though its name says so")
        if tail != b"PAR1":
            raise RecordingError(f"{path}: is a truncated Parquet file, its end is missing")
        try:
            with arrow_parquet.ParquetFile(path) as file:
                names, rows = tuple(file.schema_arrow.names), file.metadata.num_rows
        except (pa.ArrowException, OSError) as error:
            raise RecordingError(f"{path}: is a damaged Parquet file: {first_line(error)}") from None
        if rows == 0:
            raise RecordingError(f"{path}: is a Parquet file of zero rows")
        return cls(path, names)

    def pieces(self, columns: Sequence[str]) -> Iterator[Matrix]:
        """Stream columns as arrays of shape (columns, rows)."""
        try:
            # Buffered and not fetched ahead: otherwise a row group, which may be the whole file, is held at once.
            with arrow_parquet.ParquetFile(self.path, buffer_size=BUFFER_BYTES, pre_buffer=False) as file:
                for name in columns:
                    kind = file.schema_arrow.field(name).type
                    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)):
                        raise RecordingError(f"{self.path}: column {name!r} holds values of type {kind} from data row "
                                             "1 on, where numbers are needed")
                for batch in file.iter_batches(columns=list(dict.fromkeys(columns)), use_threads=False):
                    yield matrix_of(batch.select(list(columns)))
        except (pa.ArrowException, OSError) as error:
            raise RecordingError(f"{self.path}: is a damaged Parquet file: {first_line(error)}") from None

    def where(self, row: int) -> str:
        """Data row, for a row counted from 0."""
        return f"data row {row + 1}"


Table = CsvTable | ParquetTable


def open_table(path: str | Path) -> Table:
    """Open a table by its suffix; nothing but its header is read.

    Parameters
    ----------
    path : str or Path
        ``.csv``, ``.tsv``, ``.txt`` or ``.dat`` for text, ``.parquet`` or ``.pq`` for Parquet.

    Raises
    ------
    RecordingError
        The file is missing, empty, a folder, of another format, truncated, or has no header.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise RecordingError(f"{path}: is a folder, not a file")
        if path.stat().st_size == 0:
            raise RecordingError(f"{path}: is an empty file")
        if path.suffix.lower() in CSV_SUFFIXES:
            return CsvTable.open(path)
        if path.suffix.lower() in PARQUET_SUFFIXES:
            return ParquetTable.open(path)
    except FileNotFoundError:
        raise RecordingError(f"{path}: no such file") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
    raise RecordingError(f"{path}: unknown suffix {path.suffix!r}; a recording is {', '.join(CSV_SUFFIXES)} or "
                         f"{', '.join(PARQUET_SUFFIXES)}")
