"""Apache Parquet, streamed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from numpy.typing import NDArray
from pyarrow.parquet import ParquetFile

from piezo_model.recordings.arrow_columns import arrays_of, column_of
from piezo_model.recordings.chunks import BUFFER_BYTES, RecordingError
from piezo_model.recordings.tables import BATCH_ROWS, ReadOptions, Table, parsed

NAME = "a Parquet file"


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file starts like a Parquet file."""
    return head.startswith(b"PAR1")


@dataclass(frozen=True)
class ParquetTable(Table):
    """A Parquet file."""

    def batches(self, at: Sequence[int]) -> Iterator[Sequence[NDArray]]:
        """Stream columns."""
        names = [self.columns[k].name for k in at]
        # Buffered and not prefetched: otherwise a row group, which may be the whole file, is held in memory.
        with parsed(self.path, "Parquet"), ParquetFile(self.path, buffer_size=BUFFER_BYTES, pre_buffer=False) as file:
            for k in at:
                if self.columns[k].kind not in ("number", "clock"):
                    raise RecordingError(
                        f"{self.path}: column {self.columns[k].name!r} holds values of type "
                        f"{file.schema_arrow.field(k).type} from data row 1 on, where numbers are needed"
                    )
            for batch in file.iter_batches(BATCH_ROWS, columns=list(dict.fromkeys(names))):
                yield arrays_of(batch.select(names))


def open_table(path: Path, options: ReadOptions) -> ParquetTable:
    """Read the columns from the footer."""
    with parsed(path, "Parquet"), ParquetFile(path) as table:
        fields, rows = tuple(table.schema_arrow), table.metadata.num_rows
    if rows == 0:
        raise RecordingError(f"{path}: is a Parquet file of zero rows")
    return ParquetTable(path, "Parquet", tuple(column_of(field, rows) for field in fields))
