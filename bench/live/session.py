"""A live run: starts the loop, watches, records and shows it, and makes sure that the stage ends at rest.

The loop needs nobody: without this process it ramps to rest, and if the stage hangs, its process ends (see `loop`).
Another process stands by for that from the start, without this one too, opens the stage anew and ramps it to rest. A
stage that cannot be opened twice is left as it is, and the outcome states it.

Every second, new samples on the board are flushed to a stream of Arrow batches beside the requested file, so a crash or
a full disk loses at most the last second. At the end the stream is converted to Parquet and removed; if there is no
space for that, it stays, and ``identify`` reads it as it is.
"""

import errno
import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from io import FileIO
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet

from bench.live import loop
from bench.live.board import Board, State, rms
from bench.live.device import DeviceError
from bench.live.settings import LiveSettings
from bench.timing import cores
from piezo_model.atomic_file import replacing
from piezo_model.learning.events import REVERSED
from piezo_model.recordings.formats.arrow import whole_batches
from piezo_model.units import quantity

POLL_S = 0.02
EVERY_S = 1.0
"""Interval at which new samples are recorded."""


def run(settings: LiveSettings, recording: Path | None, page: tuple[str, int] | None) -> tuple[list[str], int]:
    """Run to the end, optionally with a recording and with a page at an address.

    Returns sentences on the run, and its status: 0, 1 if the stage or the recording failed, or 128 plus the number of
    the signal that ended the run. DeviceError if the page cannot be at its address, or the stage cannot be opened. Once
    it is open, signals are only noted.
    """
    board, stage, received, serve = Board(settings.rate), settings.declared, list[int](), None
    if page is not None:
        from bench.live.page import listen  # which imports the plots

        serve = listen(settings, board, page)
    resource_tracker.ensure_running()  # which the first start would do, and unblock the signals
    signal.pthread_sigmask(signal.SIG_BLOCK, loop.ENDING)  # also in the processes, until they handle them
    process = _start(loop.main, settings, board)
    rescuer = _start(loop.stand_by, settings, board, process.pid) if stage.reopens else None
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, loop.ENDING)
        _wait_until_open(settings, board, process)
        loop.handle_signals(lambda number, _: received.append(number))
        # keeps the threads of this process off the loop's core
        os.sched_setaffinity(0, set(cores.usable()) - {board.core} or {board.core})
        y, x = stage.output_unit, stage.input_unit
        columns = ("time_s", f"reference_{y}", f"drive_{x}", f"displacement_{y}")
        recorded = recording and ThreadPoolExecutor().submit(record, board, recording, columns)
        if serve is not None:
            Thread(target=serve, daemon=True).start()
        sentence = _watch(settings, board, process, rescuer, received)
    finally:
        board.set(stop=1, over=1)
        if board.state == State.STARTING:  # it has not driven the stage, and now does not
            process.kill()
    sentences = [sentence, *([recorded.result()] if recorded else []), *_figures(settings, board)]
    sentences += [event for event in board.last_events() if REVERSED in event]
    failed = board.failed or (recording is not None and not recording.exists())
    return sentences, 128 + received[0] if received else int(failed)


def _start(target: Callable[..., None], *arguments: Any) -> BaseProcess:
    process = multiprocessing.get_context("spawn").Process(target=target, args=arguments, daemon=True)
    process.start()
    return process


def _wait_until_open(settings: LiveSettings, board: Board, process: BaseProcess) -> None:
    """Wait until the stage is open; DeviceError if it cannot be opened."""
    while board.state == State.STARTING:
        if not process.is_alive():
            late = f"did not open within {loop.OPENING_S:g} s" if process.exitcode == -signal.SIGALRM else ""
            raise DeviceError(f"{settings.device}: {board.reason or late or 'the process that opens it died'}")
        time.sleep(POLL_S)


def _watch(
    settings: LiveSettings, board: Board, process: BaseProcess, rescuer: BaseProcess | None, received: list[int]
) -> str:
    """Wait until nobody drives the stage any more; return a sentence on how that came.

    A signal ends the run, and so does the death of the process that stands by.
    """
    while process.is_alive():
        time.sleep(POLL_S)
        os.kill(process.pid or 0, signal.SIGCONT)  # somebody may have stopped it, and its timer with it
        if received or (rescuer is not None and not rescuer.is_alive()):
            board.set(stop=1)
    if rescuer is not None:
        rescuer.join()
    stage, reason, at_rest = settings.declared, board.reason, board.state == State.ENDED
    if process.exitcode == -signal.SIGALRM:
        reason = f"the stage did not answer for {stage.timeout_s:g} s"
        if at_rest and not board.rescued:
            reason = f"the stage did not close within {loop.CLOSING_S:g} s"
    elif process.exitcode or not reason:
        reason = "the loop's process died"
    elif rescuer is not None and rescuer.exitcode:
        reason = "the process that stood by to bring it to rest died"
    board.set(failed=int(bool(board.failed) or not at_rest or reason != board.reason))
    if at_rest and not board.rescued:
        return f"The stage is at rest; {reason}."
    reason, last = f"{reason[0].upper()}{reason[1:]}", quantity(float(board.drive[0]), stage.input_unit)
    if at_rest:
        return f"{reason}; another process has brought the stage to rest."
    cannot = f"could not be brought to rest ({board.reason or 'the second process died'})"
    if rescuer is None:
        cannot = "cannot be opened by another process"
    return f"{reason}, and the stage {cannot}: its last drive was {last}."


def _figures(settings: LiveSettings, board: Board) -> list[str]:
    """Tracking error and timing in sentences."""
    first, samples = board.read(0)
    samples = samples[: max(0, (board.followed or board.head) - first)]
    errors = settings.late(samples[:, 1]) - samples[:, 3]
    settled = errors[-min(int(10 * settings.rate), errors.size // 2) or None :]  # without the approach
    error, last = rms(settled), f"the last {settled.size / settings.rate:.3g} s"
    tracking = (
        f"Tracking error{settings.after_lag} over {last}: {quantity(error, settings.declared.output_unit, 3)} RMS."
    )
    return [*([tracking] if math.isfinite(error) else []), board.timing()]


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
    """Record until the run is over, and return a sentence with the file and the samples that it lacks; a full disk, or
    any other failure, stops the run."""
    stream, schema = stream_beside(path), pa.schema([(name, pa.float64()) for name in names])
    try:
        with stream.open("wb", buffering=0) as file:
            gaps = _append_samples(board, file, schema)
        with replacing(path) as temporary, parquet.ParquetWriter(temporary, schema) as writer:
            for batch in whole_batches(stream):
                writer.write_batch(batch)
        stream.unlink()
    except Exception as error:
        board.set(stop=1)
        return f"Recording: {stream}, since {path} could not be written: {getattr(error, 'strerror', None) or error}"
    lost = "; ".join(f"{count} before {until:.3f} s" for count, until in gaps)
    return f"Recording: {path}" + f", without samples that the disk was too slow for: {lost}" * bool(lost)


def _append_samples(board: Board, file: FileIO, schema: pa.Schema) -> list[tuple[int, float]]:
    """Append new samples every second until the run is over; the number of samples that left the ring buffer before
    that, and the time until which, of each gap. OSError if the disk is full."""
    _append(file, schema.serialize())
    recorded, due, ended, gaps = 0, time.monotonic(), False, list[tuple[int, float]]()
    while not ended:
        ended = bool(board.over)
        if ended or time.monotonic() >= due:
            first, samples = board.read(recorded)
            if first > recorded:
                gaps.append((first - recorded, float(samples[0, 0])))
            columns = [pa.array(np.ascontiguousarray(column)) for column in samples.T]
            _append(file, pa.record_batch(columns, schema=schema).serialize())
            recorded, due = first + len(samples), due + EVERY_S
        time.sleep(POLL_S)
    return gaps


def _append(file: FileIO, message: pa.Buffer) -> None:
    if file.write(message) < message.size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    os.fdatasync(file.fileno())
