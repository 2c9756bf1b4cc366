"""Apache Parquet, streamed."""

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
from numpy.typing import NDArray
from pyarrow.parquet import ParquetFile

from piezo_model.recordings.arrow_columns import arrays_of, column_of
from piezo_model.recordings.chunks import BUFFER_BYTES, RecordingError, ahead, first_line
from piezo_model.recordings.tables import ReadOptions, Table

NAME = "a Parquet file"
BATCH_ROWS = 1 << 17


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file starts as a Parquet file."""
    return head.startswith(b"PAR1")


@dataclass(frozen=True)
class ParquetTable(Table):
    """A Parquet file."""

    def batches(self, at: Sequence[int]) -> Iterator[Sequence[NDArray]]:
        """Stream columns."""
        return ahead(self._read(at))

    def _read(self, at: Sequence[int]) -> Iterator[Sequence[NDArray]]:
        names = [self.columns[k].name for k in at]
        # Buffered and not fetched ahead: otherwise a row group, which may be the whole file, is held at once.
        with damage(self.path), ParquetFile(self.path, buffer_size=BUFFER_BYTES, pre_buffer=False) as file:
            for k in at:
                if self.columns[k].kind not in ("number", "clock"):
                    raise RecordingError(
                        f"{self.path}: column {self.columns[k].name!r} holds values of type "
                        f"{file.schema_arrow.field(k).type} from data row 1 on, where numbers are needed"
                    )
            for batch in file.iter_batches(BATCH_ROWS, columns=list(dict.fromkeys(names)), use_threads=False):
                yield arrays_of(batch.select(names))


@contextmanager
def damage(path: Path) -> Iterator[None]:
    """Say in a sentence that a file is damaged."""
    try:
        yield
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: is a damaged Parquet file: {first_line(error)}") from None


def open_table(path: Path, reading: ReadOptions) -> ParquetTable:
    """Read the columns from the footer."""
    with path.open("rb") as file:
        file.seek(-min(4, path.stat().st_size), io.SEEK_END)
        if file.read(4) != b"PAR1":
            raise RecordingError(f"{path}: is a truncated Parquet file, its end is missing")
    with damage(path), ParquetFile(path) as table:
        fields, rows = tuple(table.schema_arrow), table.metadata.num_rows
    if rows == 0:
        raise RecordingError(f"{path}: is a Parquet file of zero rows")
    return ParquetTable(path, "Parquet", tuple(column_of(field, rows) for field in fields))
