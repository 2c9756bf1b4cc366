"""Apache Parquet, streamed."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as arrow_parquet

from piezo_model.recordings.arrow_columns import matrix_of
from piezo_model.recordings.pieces import BUFFER_BYTES, Elapsed, RecordingError, ahead, first_line
from piezo_model.recordings.tables import Column, Kind, Reading
from solvers.arrays import Matrix

NAME = "a Parquet file"
ORDER = 10
BATCH_ROWS = 1 << 17


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file starts as a Parquet file."""
    return head.startswith(b"PAR1")


@dataclass(frozen=True)
class ParquetTable:
    """A Parquet file; see :class:`piezo_model.recordings.tables.Table`."""

    path: Path
    columns: tuple[Column, ...]
    form: str = "Parquet"

    def pieces(self, at: Sequence[int]) -> Iterator[Matrix]:
        """Stream columns as arrays of shape (columns, rows)."""
        return ahead(self._batches(at))

    def _batches(self, at: Sequence[int]) -> Iterator[Matrix]:
        names, clocks = [self.columns[k].name for k in at], [Elapsed() for _ in at]
        for k in at:
            if self.columns[k].kind not in ("number", "clock"):
                raise RecordingError(
                    f"{self.path}: column {self.columns[k].name!r} holds values of type "
                    f"{self._type(k)} from data row 1 on, where numbers are needed"
                )
        try:
            # Buffered and not fetched ahead: otherwise a row group, which may be the whole file, is held at once.
            with arrow_parquet.ParquetFile(self.path, buffer_size=BUFFER_BYTES, pre_buffer=False) as file:
                for batch in file.iter_batches(BATCH_ROWS, columns=list(dict.fromkeys(names)), use_threads=False):
                    yield matrix_of(batch.select(names), clocks)
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
            raise RecordingError(f"{self.path}: is a damaged Parquet file: {first_line(error)}") from None

    def where(self, row: int) -> str:
        """Data row, for a row counted from 0."""
        return f"data row {row + 1}"

    def _type(self, at: int) -> str:
        with arrow_parquet.ParquetFile(self.path) as file:
            return str(file.schema_arrow.field(at).type)


def open_table(path: Path, reading: Reading) -> ParquetTable:
    """Read the columns from the footer."""
    with path.open("rb") as file:
        file.seek(-min(4, path.stat().st_size), io.SEEK_END)
        tail = file.read(4)
    if tail != b"PAR1":
        raise RecordingError(f"{path}: is a truncated Parquet file, its end is missing")
    try:
        with arrow_parquet.ParquetFile(path) as file:
            fields, rows = tuple(file.schema_arrow), file.metadata.num_rows
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: is a damaged Parquet file: {first_line(error)}") from None
    if rows == 0:
        raise RecordingError(f"{path}: is a Parquet file of zero rows")
    return ParquetTable(path, tuple(_column(field, rows) for field in fields))


def _column(field: pa.Field, rows: int) -> Column:
    kind: Kind = "text"
    if pa.types.is_floating(field.type) or pa.types.is_integer(field.type) or pa.types.is_decimal(field.type):
        kind = "number"
    elif pa.types.is_boolean(field.type):
        kind = "flag"
    elif pa.types.is_timestamp(field.type) or pa.types.is_duration(field.type) or pa.types.is_time(field.type):
        kind = "clock"
    return Column.named(field.name, kind=kind, rows=rows)
