"""The recording: what the loop writes on the board goes to disk every second, and what is there stays readable whatever
happens.

It is a stream of Arrow batches beside the file that was asked for, each batch flushed to the disk, so that a process
that dies or a disk that fills leaves everything up to the last second. In the end the stream becomes the Parquet file,
and goes; where there is no room for that it stays, and ``identify`` reads it as it is.
"""

import os
import shutil
import signal
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet

from bench.live.board import Board, State
from piezo_model.atomic_file import replacing
from solvers.arrays import Matrix

EVERY_S = 1.0
LOOK_S = 0.05


def stream_beside(path: Path) -> Path:
    """Where the stream of a recording is."""
    return path.with_suffix(".arrow")


def check(path: Path) -> None:
    """FileExistsError where the stream of an earlier run is there, which would be lost."""
    if stream_beside(path).exists():
        raise FileExistsError(
            17,
            f"was left by a run that did not come to its end; move it away, or choose another name than {path.name}",
            str(stream_beside(path)),
        )


class Recorder:
    """One recording, begun or carried on where another process left it."""

    def __init__(self, path: Path, names: tuple[str, ...]) -> None:
        self._stream = stream_beside(path)
        self._schema = pa.schema([(name, pa.float64()) for name in names])
        whole, self.rows = _whole(self._stream)
        self._file = self._stream.open("r+b" if whole else "wb")
        self._file.truncate(whole)
        self._file.seek(whole)
        if not whole:
            self._file.write(self._schema.serialize())

    def add(self, samples: Matrix) -> None:
        """Put samples (N, columns) on the disk; OSError where there is no room, and then nothing of them."""
        at = self._file.tell()
        try:
            self._file.write(
                pa.record_batch(
                    [pa.array(np.ascontiguousarray(column)) for column in samples.T], schema=self._schema
                ).serialize()
            )
            self._file.flush()
            os.fdatasync(self._file.fileno())
        except OSError:
            os.ftruncate(self._file.fileno(), at)
            raise
        self.rows += len(samples)

    def close(self) -> None:
        """Let go of the stream."""
        self._file.close()


def finish(path: Path) -> None:
    """Make the Parquet file of the stream; OSError where there is no room, and the stream stays."""
    stream = stream_beside(path)
    with (
        replacing(path) as temporary,
        pa.OSFile(str(stream)) as source,
        pa.ipc.open_stream(source) as reader,
        parquet.ParquetWriter(temporary, reader.schema) as writer,
    ):
        for batch in reader:
            writer.write_batch(batch)
    stream.unlink()


def _whole(stream: Path) -> tuple[int, int]:
    """Bytes of a stream up to its last whole batch, and its rows; 0 of one that is not there."""
    if not stream.is_file():
        return 0, 0
    rows = 0
    end = 0
    with (
        pa.OSFile(str(stream)) as source,
        suppress(pa.ArrowException, EOFError, OSError),
    ):  # the last batch may be cut short
        schema = pa.ipc.read_schema(source)
        end = source.tell()
        while True:
            rows += pa.ipc.read_record_batch(pa.ipc.read_message(source), schema).num_rows
            end = source.tell()
    return end, rows


def main(board_path: Path, rate: float, path: Path, names: tuple[str, ...]) -> None:
    """The process of the recorder: it ends when the loop has ended, and asks the loop to stop where the disk is
    full."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    board, parent = Board(board_path, rate), os.getppid()
    recorder = Recorder(path, names)
    done, after = recorder.rows, time.monotonic() + EVERY_S
    while True:
        ended = board.state == State.ENDED
        if ended or time.monotonic() >= after:
            done, samples = board.read(done)
            try:
                if len(samples):
                    recorder.add(samples)
            except OSError as error:
                board.say(f"the recording ends here: {error.strerror}")
                board.note(stop=1)
                return
            done, after = done + len(samples), after + EVERY_S
        if ended:
            break
        time.sleep(LOOK_S)
    recorder.close()
    if os.getppid() != parent:  # nobody else is left to do it
        finish(path)
        shutil.rmtree(board_path.parent, ignore_errors=True)
