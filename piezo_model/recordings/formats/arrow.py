"""A stream of Arrow batches, as ``piezobench live`` leaves one where it could not end: read up to its last whole
batch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from piezo_model.recordings.arrow_columns import matrix_of
from piezo_model.recordings.pieces import Elapsed, RecordingError, first_line
from piezo_model.recordings.tables import Column, Reading
from solvers.arrays import Matrix

NAME = "a stream of Arrow batches"
ORDER = 11
CONTINUATION = b"\xff\xff\xff\xff"
"""With which every message of a stream begins."""


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file starts as a stream of Arrow does."""
    return head.startswith(CONTINUATION) and path.suffix in (".arrow", ".arrows")


@dataclass(frozen=True)
class ArrowTable:
    """A stream of Arrow batches; see :class:`piezo_model.recordings.tables.Table`."""

    path: Path
    columns: tuple[Column, ...]
    form: str = "Arrow stream"

    def pieces(self, at: Sequence[int]) -> Iterator[Matrix]:
        """Stream columns as arrays of shape (columns, rows)."""
        names, clocks = [self.columns[k].name for k in at], [Elapsed() for _ in at]
        for batch in batches(self.path):
            yield matrix_of(batch.select(names), clocks)

    def where(self, row: int) -> str:
        """Data row, for a row counted from 0."""
        return f"data row {row + 1}"


def batches(path: Path) -> Iterator[pa.RecordBatch]:
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


def open_table(path: Path, reading: Reading) -> ArrowTable:
    """Read the columns of the first batch and count the rows of all."""
    rows, schema = 0, None
    for batch in batches(path):
        rows, schema = rows + batch.num_rows, batch.schema
    assert schema is not None
    return ArrowTable(
        path,
        tuple(
            Column.named(field.name, kind="number" if pa.types.is_floating(field.type) else "text", rows=rows)
            for field in schema
        ),
    )
