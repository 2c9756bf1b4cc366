"""A stream of Arrow batches, as ``piezobench live`` leaves one where it could not end: read up to its last whole
batch."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
from numpy.typing import NDArray

from piezo_model.recordings.arrow_columns import arrays_of, column_of
from piezo_model.recordings.chunks import RecordingError, first_line
from piezo_model.recordings.tables import ReadOptions, Table

NAME = "a stream of Arrow batches"
CONTINUATION = b"\xff\xff\xff\xff"
"""With which every message of a stream begins."""


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file starts as a stream of Arrow does."""
    return head.startswith(CONTINUATION) and path.suffix in (".arrow", ".arrows")


@dataclass(frozen=True)
class StreamTable(Table):
    """A stream of Arrow batches."""

    def batches(self, at: Sequence[int]) -> Iterator[Sequence[NDArray]]:
        """Stream columns."""
        for batch in whole_batches(self.path):
            yield arrays_of(batch.select([self.columns[k].name for k in at]))


def whole_batches(path: Path) -> Iterator[pa.RecordBatch]:
    """The whole batches of a stream, in order; RecordingError where there is none."""
    count = 0
    with pa.OSFile(str(path)) as source:
        try:
            reader = pa.ipc.open_stream(source)
        except (pa.ArrowException, OSError) as error:
            raise RecordingError(f"{path}: is a damaged Arrow stream: {first_line(error)}") from None
        while True:
            try:
                batch = reader.read_next_batch()
            except (StopIteration, pa.ArrowException, OSError):  # the end, or a last batch that was cut short
                break
            count += 1
            yield batch
    if not count:
        raise RecordingError(f"{path}: is an Arrow stream without a whole batch")


def open_table(path: Path, reading: ReadOptions) -> StreamTable:
    """Read the columns of the first batch and count the rows of all."""
    schemas, rows = zip(*((batch.schema, batch.num_rows) for batch in whole_batches(path)), strict=True)
    return StreamTable(path, "Arrow stream", tuple(column_of(field, sum(rows)) for field in schemas[0]))
