"""A part of a race on disk: an Arrow stream with a batch for each finished task, and one for the notes at its end.

A batch holds the row of a task and its raw nanoseconds by name. It is written out before the next task starts, so that
a process that is killed leaves one truncated batch at most; whoever opens the part again copies the whole ones, and
appends to them. The notes come last, and mark the part as done.
"""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from bench.messages.columns import named, schema
from bench.messages.task import Row
from bench.race_table import ROWS
from piezo_model.atomic_file import replacing
from piezo_model.checks import check
from piezo_model.json_file import decoded

TIMES = schema(named("task", "timed", "repeat", "what", "ns"))
STREAM = ROWS.append(pa.field("raw", pa.list_(pa.struct([TIMES.field("what"), TIMES.field("ns")]))))
NOTES = b"notes"
"""Key of the notes in the metadata of the last batch."""


class PartFile:
    """The finished tasks of a part and its notes, as they are on disk; a file that is not there has none.

    ValueError if the file is damaged other than by a process that was killed while it wrote.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[str, Row] = {}
        """The row of each finished task, by `Task.key`."""
        self.notes: dict[str, Any] | None = None
        """Host, core, disturbances and the sentinel's samples; None until all tasks are done."""
        self._batches: list[pa.RecordBatch] = []
        if path.exists():
            content = pa.BufferReader(path.read_bytes())  # at once, since a race may be writing
            try:
                self._read(pa.ipc.open_stream(content))
            except (pa.ArrowException, OSError, ValueError) as error:
                if content.read(1):  # of a batch that was not finished nothing is left to read
                    raise ValueError(
                        f"{path} is damaged ({error}); remove it and resume the run, and its tasks are done again"
                    ) from None

    def _read(self, stream: pa.RecordBatchReader) -> None:
        check(stream.schema.equals(STREAM), "its columns are not those of a race")
        for batch, metadata in iter(stream.read_next_batch_with_custom_metadata, None):  # until StopIteration
            batch.validate(full=True)
            if metadata is None:
                self._keep(batch)
            else:
                self.notes = decoded(metadata[NOTES].decode(), dict[str, Any])

    def _keep(self, batch: pa.RecordBatch) -> None:
        (row,) = batch.select(ROWS.names).to_pylist()
        self.rows["{task}-{timed}-{repeat}".format_map(row)] = row
        self._batches.append(batch)

    @contextmanager
    def appended(self) -> Iterator[None]:
        """Open it to save tasks and notes."""
        with replacing(self.path) as temporary:
            self._file = temporary.open("wb")
            self._writer = pa.ipc.new_stream(self._file, STREAM)
            for batch in self._batches:
                self._writer.write_batch(batch)
            self._file.flush()
        with self._file:
            yield

    def save(self, row: Row, times: Mapping[str, Any]) -> None:
        """Save the row of a finished task, and its raw nanoseconds by name."""
        batch = pa.RecordBatch.from_pylist(
            [{**row, "raw": [{"what": what, "ns": np.asarray(ns)} for what, ns in times.items()]}], STREAM
        )
        self._writer.write_batch(batch)
        self._file.flush()
        self._keep(batch)

    def finish(self, notes: dict[str, Any]) -> None:
        """Save the notes, and flush everything to disk."""
        self._writer.write_batch(pa.RecordBatch.from_pylist([], STREAM), {NOTES: json.dumps(notes)})
        self._file.flush()
        os.fsync(self._file.fileno())
        self.notes = notes

    @property
    def table(self) -> pa.Table:
        """The rows, with their raw nanoseconds in a column of lists."""
        return pa.Table.from_batches(self._batches, STREAM)


def times_of(table: pa.Table) -> pa.Table:
    """The raw nanoseconds of the tables of parts, a row for each name."""
    table = table.combine_chunks()
    line = pc.list_parent_indices(table["raw"])
    raw = pc.list_flatten(table["raw"]).combine_chunks().flatten()
    return pa.table([*(table[name].take(line) for name in TIMES.names[:3]), *raw], TIMES)
