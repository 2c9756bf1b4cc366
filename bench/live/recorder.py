"""Recording of a live run: every second, new samples on the board are flushed to disk.

They go to a stream of Arrow batches beside the requested file, so a crash or a full disk loses at most the last second.
At the end the stream is converted to Parquet and removed; if there is no space for that, it stays, and ``identify``
reads it as it is.
"""

import errno
import os
import time
from io import FileIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet

from bench.live.board import Board
from piezo_model.atomic_file import replacing
from piezo_model.recordings.formats.arrow import whole_batches

EVERY_S = 1.0
POLL_S = 0.05


def stream_beside(path: Path) -> Path:
    """Path of the stream of a recording."""
    return path.with_suffix(".arrow")


def check(path: Path) -> None:
    """FileExistsError if there is a recording of that name, or the stream that an interrupted run left of it."""
    for there, what in (
        (path, "is a recording"),
        (stream_beside(path), "was left by a run that did not come to its end"),
    ):
        if there.exists():
            raise FileExistsError(
                errno.EEXIST, f"{what}; move it away, or choose another name than {path.name}", str(there)
            )


def record(board: Board, path: Path, names: tuple[str, ...]) -> str:
    """Record until the run is over, and return a sentence with the file; a full disk, or any other failure, stops the
    run."""
    stream, schema = stream_beside(path), pa.schema([(name, pa.float64()) for name in names])
    try:
        with stream.open("wb", buffering=0) as file:
            _append_samples(board, file, schema)
        with replacing(path) as temporary, parquet.ParquetWriter(temporary, schema) as writer:
            for batch in whole_batches(stream):
                writer.write_batch(batch)
        stream.unlink()
    except Exception as error:
        board.set(stop=1)
        return f"Recording: {stream}, since {path} could not be written: {getattr(error, 'strerror', None) or error}"
    return f"Recording: {path}"


def _append_samples(board: Board, file: FileIO, schema: pa.Schema) -> None:
    """Append new samples every second until the run is over; OSError if the disk is full."""
    _append(file, schema.serialize())
    recorded, due, ended = 0, time.monotonic(), False
    while not ended:
        ended = bool(board.over)
        if ended or time.monotonic() >= due:
            first, samples = board.read(recorded)
            columns = [pa.array(np.ascontiguousarray(column)) for column in samples.T]
            _append(file, pa.record_batch(columns, schema=schema).serialize())
            recorded, due = first + len(samples), due + EVERY_S
        time.sleep(POLL_S)


def _append(file: FileIO, message: pa.Buffer) -> None:
    if file.write(message) < message.size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    os.fdatasync(file.fileno())
