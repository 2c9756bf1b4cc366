"""A live run, in the process of the command: starts the loop and the process that stands by, watches, records and shows
the loop, and says how the run ended.

The stage needs nobody here: without this process the loop ramps to rest, and if the stage hangs, its process ends and
another one opens it anew and ramps it to rest (see `loop`).

Every second, new samples on the board are flushed to a stream of Arrow batches beside the requested file, so a crash or
a full disk loses at most the last second. At the end the stream is converted to Parquet and removed; if there is no
space for that, it stays, and ``identify`` reads it as it is.
"""

import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import get_context, resource_tracker
from multiprocessing.process import BaseProcess
from pathlib import Path
from socket import socket
from threading import Event

import pyarrow as pa
from pyarrow import parquet

from bench.live import loop
from bench.live.board import Board, State, new_board
from bench.live.device import Declared, LiveError
from bench.live.settings import LiveSettings
from bench.timing import cores
from piezo_model.atomic_file import replacing
from piezo_model.learning.events import REVERSED
from piezo_model.recordings.formats.arrow import whole_batches
from piezo_model.units import quantity

POLL_S = 0.02
EVERY_S = 1.0
"""Interval at which new samples are recorded."""
SETTLED_S = 10.0
"""Longest end of a run whose tracking error is reported."""


def run(settings: LiveSettings, recording: Path | None, page: tuple[str, int] | None) -> tuple[list[str], int]:
    """Run to the end, optionally with a recording and with a page at an address.

    Returns sentences on the run, and its status: 0, 1 if the stage or the recording failed, or 128 plus the number of
    the signal that ended the run. LiveError if the page cannot be at its address, or the stage cannot be opened.
    """
    board, received, over, spawn = new_board(), list[int](), Event(), get_context("spawn")
    with cores.claim() as core:
        # keeps the threads of this process off the loop's core
        os.sched_setaffinity(0, set(cores.usable()) - {core.number} or {core.number})
        if page is not None:
            from bench.live.page import Page  # which imports the plots

            Page(settings, board, *page)
        resource_tracker.ensure_running()  # which the first start would do, and unblock the signals
        signal.pthread_sigmask(signal.SIG_BLOCK, loop.ENDING)  # also in the processes, until they handle them
        lock = socket(fileno=os.dup(core.fileno()))
        process = spawn.Process(target=loop.main, args=(settings, board, core.number, lock), daemon=True)
        process.start()
        rescuer = spawn.Process(target=loop.stand_by, args=(settings, board, process.pid), daemon=True)
        rescuer.start()
        loop.handle_signals(lambda number, _: received.append(number))
        while board.state == State.STARTING and process.is_alive() and not received:
            time.sleep(POLL_S)
        if board.state == State.STARTING:
            process.kill()  # it has not driven the stage, and now does not
            if received:
                return [], 128 + received[0]
            late = process.exitcode == -signal.SIGALRM and f"did not open within {loop.OPENING_S:g} s"
            raise LiveError(f"{settings.name}: {board.reason or late or 'the process that opens it died'}")
        recorded = recording and ThreadPoolExecutor().submit(record, board, recording, settings.declared, over)
        try:
            while process.is_alive():
                time.sleep(POLL_S)
                os.kill(process.pid or 0, signal.SIGCONT)  # somebody may have stopped it, and its timer with it
                if received or not rescuer.is_alive():
                    board.stop = 1
            rescuer.join()
        finally:
            board.stop = 1
            over.set()
    sentence, is_well = outcome(settings, board, process, rescuer)
    first, samples = board.read(0)
    samples = samples[: max(0, (board.followed or board.head) - first)]
    _, tracking = settings.tracking(samples, min(int(SETTLED_S * settings.rate), len(samples) // 2) or 1)
    sentences = [
        sentence,
        recorded.result() if recorded else "",
        tracking,
        board.timing(settings.rate),
        *(event for event in board.last_events() if REVERSED in event),
    ]
    is_well = is_well and (recording is None or recording.exists())
    return [*filter(None, sentences)], 128 + received[0] if received else int(not is_well)


def outcome(settings: LiveSettings, board: Board, process: BaseProcess, rescuer: BaseProcess) -> tuple[str, bool]:
    """How the run ended, in a sentence, and whether it ended as it should; nobody drives the stage any more."""
    stage, reason, is_at_rest = settings.declared, board.reason, board.state == State.AT_REST
    if process.exitcode == -signal.SIGALRM:
        late = f"close within {loop.CLOSING_S:g} s" if is_at_rest else f"answer for {stage.timeout_s:g} s"
        reason = f"the stage did not {late}"
    elif process.exitcode or not reason:
        reason = "the loop's process died"
    elif rescuer.exitcode:
        reason = "the process that stood by to bring it to rest died"
    if is_at_rest:
        return f"The stage is at rest; {reason}.", reason in (loop.TIME_OVER, loop.STOP_REQUESTED)
    reason = f"{reason[0].upper()}{reason[1:]}"
    if board.state == State.BROUGHT_TO_REST:
        return f"{reason}; another process has brought the stage to rest.", False
    why = "the second process died" if rescuer.exitcode else board.reason
    cannot = f"could not be brought to rest ({why})" if stage.reopens else "cannot be opened by another process"
    return f"{reason}, and the stage {cannot}: its last drive was {quantity(board.drive, stage.input_unit)}.", False


def stream_beside(path: Path) -> Path:
    """Path of the stream of a recording."""
    return path.with_suffix(".arrow")


def record(board: Board, path: Path, stage: Declared, over: Event) -> str:
    """Record until the run is over, and return a sentence with the file and the samples that it lacks, which left the
    ring of the board before; a full disk, or any other failure, stops the run."""
    x, y = stage.input_unit, stage.output_unit
    names = ("time_s", f"reference_{y}", f"drive_{x}", f"displacement_{y}")
    stream, schema = stream_beside(path), pa.schema([(name, pa.float64()) for name in names])
    recorded, lost, is_over = 0, list[str](), False
    try:
        with stream.open("wb") as file, pa.ipc.new_stream(file, schema) as writer:
            while not is_over:
                is_over = over.wait(EVERY_S)
                first, samples = board.read(recorded)
                if first > recorded:
                    lost.append(f"{first - recorded} before {samples[0, 0]:.3f} s")
                writer.write_batch(pa.record_batch([*samples.T], schema=schema))
                file.flush()
                os.fdatasync(file.fileno())
                recorded = first + len(samples)
        with replacing(path) as temporary, parquet.ParquetWriter(temporary, schema) as table:
            for batch in whole_batches(stream):
                table.write_batch(batch)
        stream.unlink()
    except Exception as error:
        board.stop = 1
        return f"Recording: {stream}, since {path} could not be written: {getattr(error, 'strerror', None) or error}"
    return f"Recording: {path}" + f", without samples that the disk was too slow for: {'; '.join(lost)}" * bool(lost)
