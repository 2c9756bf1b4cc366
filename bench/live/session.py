"""A live run: starts the loop, watches, records and shows it, and sees to it that the stage ends at rest.

The loop is watched by its beat. Where it hangs longer than the stage allows, or dies, its process is ended and another
one opens the stage and ramps it to rest; a stage that cannot be opened twice is left as it is, which is said.
"""

import math
import multiprocessing
import os
import secrets
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Thread
from types import FrameType
from typing import Any

import numpy as np

from bench.live import loop
from bench.live.board import Board, State, edges_us
from bench.live.device import DeviceError
from bench.live.recorder import record
from bench.live.task import Task
from piezo_model.units import quantity

LOOK_S = 0.02
OPENING_S = 60.0
"""Longest that a stage may take to open."""
IN_MEMORY = Path("/dev/shm")


@dataclass(frozen=True)
class Outcome:
    """What became of a run."""

    sentences: list[str]
    status: int
    """0, or 128 and the number of the signal that ended it, or 1 where the stage failed."""


def run(task: Task, recording: Path | None, page: tuple[str, int] | None, told: Callable[[str], None]) -> Outcome:
    """Run a task to its end, with a recording and a page at an address where asked for.

    ``told`` hears what a person should know meanwhile. DeviceError where the stage cannot be opened.
    """
    shared = IN_MEMORY if IN_MEMORY.is_dir() else None
    with tempfile.TemporaryDirectory(prefix="piezobench-live-", dir=shared) as folder, _signals() as received:
        path = Path(folder) / "board"
        board = Board(path, task.rate, task.model, make=True)
        process = _opened(task, path)
        cores = os.sched_getaffinity(0)
        os.sched_setaffinity(0, cores - {board.core} or cores)  # so that no thread here takes the loop's core
        with ThreadPoolExecutor() as pool:
            recorded = recording and pool.submit(record, board, recording, _columns(task))
            if page is not None:
                from bench.live.page import serve  # which needs Bokeh

                Thread(target=serve, args=(board, task, page, secrets.token_urlsafe(16), told), daemon=True).start()
            try:
                sentence = _watch(task, path, board, process, received)
            finally:
                board.note(state=State.ENDED)
        os.sched_setaffinity(0, cores)
        sentences = [sentence, *([recorded.result()] if recorded else []), *_figures(task, board)]
        return Outcome(sentences, 128 + received[0] if received else board.failed)


def _columns(task: Task) -> tuple[str, ...]:
    """Of the recording."""
    d = task.declared
    return ("time_s", f"reference_{d.output_unit}", f"drive_{d.input_unit}", f"displacement_{d.output_unit}")


def _start(target: Callable[..., None], *arguments: Any) -> BaseProcess:
    process = multiprocessing.get_context("spawn").Process(target=target, args=arguments, daemon=True)
    process.start()
    return process


def _loop(task: Task, path: Path, ready: Connection) -> None:
    loop.main(task, path, ready.send)


def _opened(task: Task, path: Path) -> BaseProcess:
    """Start the loop and wait until the stage is open."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = _start(_loop, task, path, theirs)
    theirs.close()
    try:
        said = ours.recv() if ours.poll(OPENING_S) else f"{task.device}: did not open within {OPENING_S:g} s"
    except EOFError:
        said = f"{task.device}: the process that opens it died"
    if said:
        process.kill()
        raise DeviceError(said)
    return process


def _watch(task: Task, path: Path, board: Board, process: BaseProcess, received: list[int]) -> str:
    """Wait for the end of the loop; how it came, in a sentence."""
    timeout_s = task.declared.timeout_s
    limit_ns = 1e9 * (timeout_s + 1.0 / task.rate)  # a beat comes once a period
    while process.is_alive():
        time.sleep(LOOK_S)
        if received:
            board.note(stop=1)
        beat = board.beat_ns
        if beat and time.perf_counter_ns() - beat > limit_ns and board.state != State.ENDED:
            process.kill()
            process.join()
            return _rescued(task, path, board, f"the stage did not answer for {timeout_s:g} s")
    if board.state != State.ENDED:
        return _rescued(task, path, board, board.why or "the loop's process died")
    return f"The stage is at rest; {board.why}."


def _rescued(task: Task, path: Path, board: Board, why: str) -> str:
    """Bring the stage to rest from outside; what became of it."""
    board.note(failed=1)
    declared, why = task.declared, f"{why[0].upper()}{why[1:]}"
    left = f"its drive was {quantity(float(board.drive[0]), declared.input_unit)} at last"
    if not declared.reopens:
        return f"{why}, and the stage cannot be opened by another process: {left}."
    process = _start(loop.rescue, task, path)
    process.join((declared.x_limits[1] - declared.x_limits[0]) / declared.rate_limit + OPENING_S)
    if board.state == State.ENDED:
        return f"{why}; another process has brought the stage to rest."
    process.kill()
    return f"{why}, and the stage could not be brought to rest: {left}."


def _figures(task: Task, board: Board) -> list[str]:
    """What the run was like."""
    first, samples = board.read(0)
    samples = samples[: max(0, (board.followed or board.head) - first)]
    samples = samples[-min(int(10 * task.rate), len(samples) // 2) or None :]  # without the way to it
    error = samples[:, 1] - samples[:, 3]
    error = error[np.isfinite(error)]
    counted, edges = np.cumsum(board.service), edges_us()
    median, tail = (
        float(edges[1 + int(np.searchsorted(counted, share * counted[-1]))]) if counted[-1] else math.nan
        for share in (0.5, 0.999)
    )
    found = [
        f"{board.head} samples at {task.rate:g} Hz; service {median:.3g} µs at the median and {tail:.3g} µs at p99.9; "
        f"{board.missed} deadlines were missed, and {board.late_null} of {board.null_samples} by a loop that does "
        "nothing."
    ]
    if error.size:
        rms = quantity(float(np.sqrt(np.mean(error**2))), task.declared.output_unit, 3)
        found.insert(0, f"Tracking error over the last {error.size / task.rate:.3g} s: {rms} RMS.")
    return found


@contextmanager
def _signals() -> Iterator[list[int]]:
    """Have the signals that end a program noted."""
    received: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        received.append(number)

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, note) for number in numbers]
    try:
        yield received
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
