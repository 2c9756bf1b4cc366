"""A stream of Arrow batches, which ``piezobench live`` leaves if it is interrupted; read up to its last whole batch."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
from numpy.typing import NDArray

from piezo_model.recordings.arrow_columns import arrays_of, column_of
from piezo_model.recordings.tables import ReadOptions, Table, parsed

NAME = "a stream of Arrow batches"
CONTINUATION = b"\xff\xff\xff\xff"
"""First bytes of every message of a stream."""


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file starts like a stream of Arrow."""
    return head.startswith(CONTINUATION) and path.suffix in (".arrow", ".arrows")


@dataclass(frozen=True)
class StreamTable(Table):
    """A stream of Arrow batches."""

    def batches(self, at: Sequence[int]) -> Iterator[Sequence[NDArray]]:
        """Stream columns."""
        for batch in whole_batches(self.path):
            yield arrays_of(batch.select([self.columns[k].name for k in at]))


def whole_batches(path: Path) -> Iterator[pa.RecordBatch]:
    """The batches of a stream in order, up to a truncated one."""
    with pa.OSFile(str(path)) as source, suppress(pa.ArrowException, OSError):
        yield from pa.ipc.open_stream(source)


def open_table(path: Path, options: ReadOptions) -> StreamTable:
    """Read the columns."""
    with parsed(path, "Arrow stream"), pa.OSFile(str(path)) as source:
        schema = pa.ipc.open_stream(source).schema
    return StreamTable(path, "Arrow stream", tuple(map(column_of, schema)))
