"""The recording: what the loop writes on the board goes to disk every second, and what is there stays readable whatever
happens.

It is a stream of Arrow batches beside the file that was asked for, each batch flushed to the disk, so that a process
that dies or a disk that fills leaves everything up to the last second. In the end the stream becomes the Parquet file,
and goes; where there is no room for that it stays, and ``identify`` reads it as it is.
"""

import errno
import os
import time
from io import FileIO
from itertools import chain
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet

from bench.live.board import Board, State
from piezo_model.atomic_file import replacing
from piezo_model.recordings.formats.arrow import whole_batches

EVERY_S = 1.0
LOOK_S = 0.05


def stream_beside(path: Path) -> Path:
    """Where the stream of a recording is."""
    return path.with_suffix(".arrow")


def check(path: Path) -> None:
    """FileExistsError where the stream of an earlier run is there, which would be lost."""
    if stream_beside(path).exists():
        raise FileExistsError(
            errno.EEXIST,
            f"was left by a run that did not come to its end; move it away, or choose another name than {path.name}",
            str(stream_beside(path)),
        )


def record(board: Board, path: Path, names: tuple[str, ...]) -> str:
    """Record until the loop has ended, which is asked to stop where the disk is full; where the recording is, in a
    sentence."""
    stream = stream_beside(path)
    try:
        with stream.open("wb", buffering=0) as file:
            _follow(board, file, pa.schema([(name, pa.float64()) for name in names]))
        _finish(path)
    except OSError as error:
        board.note(stop=1)
        return f"Recording: {stream}, since {path} could not be written: {error.strerror}"
    return f"Recording: {path}"


def _follow(board: Board, file: FileIO, schema: pa.Schema) -> None:
    """Put what is new on the disk every second; OSError where there is no room."""
    _put(file, schema.serialize())
    done, due, ended = 0, time.monotonic(), False
    while not ended:
        ended = board.state == State.ENDED
        if ended or time.monotonic() >= due:
            first, samples = board.read(done)
            columns = [pa.array(np.ascontiguousarray(column)) for column in samples.T]
            _put(file, pa.record_batch(columns, schema=schema).serialize())
            done, due = first + len(samples), due + EVERY_S
        time.sleep(LOOK_S)


def _put(file: FileIO, message: pa.Buffer) -> None:
    if file.write(message) < message.size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    os.fdatasync(file.fileno())


def _finish(path: Path) -> None:
    """Make the Parquet file of the stream; OSError where there is no room, and the stream stays."""
    stream = stream_beside(path)
    batches = whole_batches(stream)
    first = next(batches)
    with replacing(path) as temporary, parquet.ParquetWriter(temporary, first.schema) as writer:
        for batch in chain([first], batches):
            writer.write_batch(batch)
    stream.unlink()
