"""A live run: starts the loop, watches, records and shows it, and makes sure that the stage ends at rest.

The loop writes the time of every sample. If it is silent longer than the stage allows, or dies, its process is killed
and another one opens the stage and ramps it to rest; a stage that cannot be opened twice is left as it is, and the
outcome states it.
"""

import math
import multiprocessing
import os
import secrets
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from bench.live import loop
from bench.live.board import Board, State, edges_us
from bench.live.device import DeviceError
from bench.live.recorder import record
from bench.live.task import Task
from piezo_model.learning.learner import REVERSED
from piezo_model.units import quantity

POLL_S = 0.02
OPENING_S = 60.0
"""Longest time in which a stage may open."""


@dataclass(frozen=True)
class Outcome:
    """How a run ended."""

    sentences: list[str]
    status: int
    """0, 1 if the stage failed, or 128 plus the number of the signal that ended the run."""


def run(task: Task, recording: Path | None, page: tuple[str, int] | None, notify: Callable[[str], None]) -> Outcome:
    """Run a task to its end, optionally with a recording and with a page at an address.

    ``notify`` receives messages for the user during the run. DeviceError if the stage cannot be opened.
    """
    board, stage = Board(task.rate, task.model), task.declared
    with _signals() as received:
        process = _start_loop(task, board)
        cores = os.sched_getaffinity(0)
        os.sched_setaffinity(0, cores - {board.core} or cores)  # keeps the threads of this process off the loop's core
        with ThreadPoolExecutor() as pool:
            columns = (
                "time_s",
                *(
                    f"{name}_{unit}"
                    for name, unit in (
                        ("reference", stage.output_unit),
                        ("drive", stage.input_unit),
                        ("displacement", stage.output_unit),
                    )
                ),
            )
            recorded = recording and pool.submit(record, board, recording, columns)
            if page is not None:
                from bench.live.page import serve  # which imports Bokeh

                Thread(target=serve, args=(board, task, page, secrets.token_urlsafe(16), notify), daemon=True).start()
            try:
                sentence = _watch(task, board, process, received)
            finally:
                board.set(state=State.ENDED)
        os.sched_setaffinity(0, cores)
        reversed_output = [event for event in board.last_events() if REVERSED in event]
        sentences = [sentence, *([recorded.result()] if recorded else []), *_figures(task, board), *reversed_output]
        return Outcome(sentences, 128 + received[0] if received else board.failed)


def _start(target: Callable[..., None], *arguments: Any) -> BaseProcess:
    process = multiprocessing.get_context("spawn").Process(target=target, args=arguments, daemon=True)
    process.start()
    return process


def _start_loop(task: Task, board: Board) -> BaseProcess:
    """Start the loop and wait until the stage is open."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = _start(loop.main, task, board, theirs)
    theirs.close()
    try:
        refusal = ours.recv() if ours.poll(OPENING_S) else f"{task.device}: did not open within {OPENING_S:g} s"
    except EOFError:
        refusal = f"{task.device}: the process that opens it died"
    if refusal:
        process.kill()
        raise DeviceError(refusal)
    return process


def _watch(task: Task, board: Board, process: BaseProcess, received: list[int]) -> str:
    """Wait for the end of the loop; return a sentence on how it came."""
    timeout_s = task.declared.timeout_s
    limit_ns = 1e9 * (timeout_s + 1.0 / task.rate)  # samples are a period apart
    while process.is_alive():
        time.sleep(POLL_S)
        if received:
            board.set(stop=1)
        beat = board.beat_ns
        if beat and time.perf_counter_ns() - beat > limit_ns and board.state != State.ENDED:
            process.kill()
            process.join()
            return _rescue(task, board, f"the stage did not answer for {timeout_s:g} s")
    if board.state != State.ENDED:
        return _rescue(task, board, board.reason or "the loop's process died")
    return f"The stage is at rest; {board.reason}."


def _rescue(task: Task, board: Board, reason: str) -> str:
    """Bring the stage to rest from another process; return a sentence on the result."""
    board.set(failed=1)
    stage, reason = task.declared, f"{reason[0].upper()}{reason[1:]}"
    last = f"its last drive was {quantity(float(board.drive[0]), stage.input_unit)}"
    if not stage.reopens:
        return f"{reason}, and the stage cannot be opened by another process: {last}."
    process = _start(loop.rescue, task, board)
    process.join((stage.x_limits[1] - stage.x_limits[0]) / stage.rate_limit + OPENING_S)
    if board.state == State.ENDED:
        return f"{reason}; another process has brought the stage to rest."
    process.kill()
    return f"{reason}, and the stage could not be brought to rest: {last}."


def _figures(task: Task, board: Board) -> list[str]:
    """Tracking error and timing in sentences."""
    first, samples = board.read(0)
    samples = samples[: max(0, (board.followed or board.head) - first)]
    samples = samples[-min(int(10 * task.rate), len(samples) // 2) or None :]  # without the approach to the reference
    error = samples[:, 1] - samples[:, 3]
    error = error[np.isfinite(error)]
    counts, edges = np.cumsum(board.service), edges_us()
    median, tail = (
        float(edges[1 + int(np.searchsorted(counts, share * counts[-1]))]) if counts[-1] else math.nan
        for share in (0.5, 0.999)
    )
    sentences = [
        f"{board.head} samples at {task.rate:g} Hz; service {median:.3g} µs at the median and {tail:.3g} µs at p99.9; "
        f"{board.missed} deadlines were missed, and {board.null_missed} of {board.null_samples} by a loop that does "
        "nothing."
    ]
    if error.size:
        rms = quantity(float(np.sqrt(np.mean(error**2))), task.declared.output_unit, 3)
        sentences.insert(0, f"Tracking error over the last {error.size / task.rate:.3g} s: {rms} RMS.")
    return sentences


@contextmanager
def _signals() -> Iterator[list[int]]:
    """Collect the signals that would end this process: not those that it ignores, SIGHUP under nohup for example."""
    received: list[int] = []
    numbers = [
        number
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        if signal.getsignal(number) is not signal.SIG_IGN
    ]
    before = [signal.signal(number, lambda number, _: received.append(number)) for number in numbers]
    try:
        yield received
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
