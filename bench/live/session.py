"""A live run: starts the processes, watches them, and sees to it that the stage ends at rest.

The loop is watched by its beat. Where it hangs longer than the stage allows, or dies, its process is ended and another
one opens the stage and ramps it to rest; a stage that cannot be opened twice is left as it is, which is said. A
recorder or page that dies is started again.
"""

import math
import multiprocessing
import os
import secrets
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from bench.live import loop, recorder
from bench.live.board import Board, State, edges_us
from bench.live.controller import Controller, Plan
from bench.live.device import Declared, DeviceError, DeviceFile, Simulated
from bench.live.loop import Task
from bench.live.recorder import finish, stream_beside
from bench.live.reference import Reference
from piezo_model.units import quantity

LOOK_S = 0.02
OPENING_S = 60.0
"""Longest that a stage may take to open."""
CLOSING_S = 30.0
SHORT_LIFE_S, MOST_SHORT_LIVES = 2.0, 3
"""A process that ends so soon so often is not started again."""
IN_MEMORY = Path("/dev/shm")


@dataclass
class Helper:
    """A process beside the loop that is started again where it dies."""

    name: str
    start: Callable[[], BaseProcess]
    process: BaseProcess = field(init=False)
    _since: float = 0.0
    _short: int = 0

    def __post_init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Start it."""
        self.process, self._since = self.start(), time.monotonic()

    def keep(self) -> bool:
        """Start it again if it has died; False where that is of no use any more."""
        if self.process.is_alive() or self.process.exitcode == 0:
            return True
        self._short = self._short + 1 if time.monotonic() - self._since < SHORT_LIFE_S else 0
        if self._short >= MOST_SHORT_LIVES:
            return False
        self.begin()
        return True


@dataclass(frozen=True)
class Outcome:
    """What became of a run."""

    sentences: list[str]
    status: int
    """0, or 128 and the number of the signal that ended it, or 1 where the stage failed."""


class Session:
    """One live run of a stage."""

    def __init__(
        self,
        device: DeviceFile | Simulated,
        plan: Plan,
        reference: Callable[[Declared], Reference],
        rate: float,
        seconds: float,
        record: Path | None = None,
        page: tuple[str, int] | None = None,
    ) -> None:
        """Check all that can be checked before the first sample; DeviceError, ModelError or ReferenceError says what is
        wrong."""
        made = device.make()
        self.declared = Declared.of(made, str(device))
        self._record, self._page, self.token = record, page, secrets.token_urlsafe(16)
        Controller.of(plan, self.declared, 1.0 / rate)
        if record is not None:
            recorder.check(record)
        if page is not None:
            from bench.live.page import check  # which needs Bokeh

            check(*page)
        wanted = reference(self.declared)
        self._folder = Path(tempfile.mkdtemp(prefix="piezobench-live-", dir=IN_MEMORY if IN_MEMORY.is_dir() else None))
        self.task = Task(self._folder / "board", device, plan, wanted, rate, seconds)
        self.board = Board(self.task.board, rate, make=True)
        self._context, self._signal = multiprocessing.get_context("spawn"), 0

    @property
    def columns(self) -> tuple[str, ...]:
        """Of the recording."""
        d = self.declared
        return ("time_s", f"reference_{d.output_unit}", f"drive_{d.input_unit}", f"displacement_{d.output_unit}")

    def run(self, told: Callable[[str], None]) -> Outcome:
        """Run it to its end; ``told`` hears what a person should know meanwhile."""
        try:
            with self._signals():
                return self._run(told)
        finally:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _run(self, told: Callable[[str], None]) -> Outcome:
        main = self._open()
        before, others = os.sched_getaffinity(0), os.sched_getaffinity(0) - {self.board.core}
        os.sched_setaffinity(
            0, others or before
        )  # so that neither this process nor those beside the loop take its core
        try:
            return self._beside(main, told)
        finally:
            os.sched_setaffinity(0, before)

    def _beside(self, main: BaseProcess, told: Callable[[str], None]) -> Outcome:
        """Record and show the run, and wait for its end."""
        beside = []
        if self._record is not None:
            beside.append(
                Helper(
                    "recorder",
                    lambda: self._start(recorder.main, self.task.board, self.task.rate, self._record, self.columns),
                )
            )
        if self._page is not None:
            from bench.live import page

            beside.append(
                Helper("page", lambda: self._start(page.main, self.task, self.declared, self._page, self.token))
            )
        found = self._watch(main, beside, told)
        self.board.note(state=State.ENDED)
        for helper in beside:
            if helper.name == "page":
                helper.process.terminate()
            helper.process.join(CLOSING_S)
        if self._record is not None:
            found.append(self._finished(beside[0]))
        return Outcome([*found, *self._figures()], 128 + self._signal if self._signal else 1 if self._failed else 0)

    def _start(self, target: Callable[..., None], *arguments: Any) -> BaseProcess:
        process = self._context.Process(target=target, args=arguments, daemon=True)
        process.start()
        return process

    def _open(self) -> BaseProcess:
        """Start the loop and wait until the stage is open."""
        ours, theirs = self._context.Pipe(duplex=False)
        main = self._start(_loop, self.task, theirs)
        theirs.close()
        try:
            said = ours.recv() if ours.poll(OPENING_S) else f"{self.task.device}: did not open within {OPENING_S:g} s"
        except EOFError:
            said = f"{self.task.device}: the process that opens it died"
        if said:
            main.kill()
            raise DeviceError(said)
        return main

    def _watch(self, main: BaseProcess, beside: list[Helper], told: Callable[[str], None]) -> list[str]:
        """Wait for the end of the loop; what a person should know of it."""
        self._failed, unannounced = False, self._page
        while main.is_alive():
            time.sleep(LOOK_S)
            if unannounced and self.board.page:
                told("Page: http://{}:{}/{}".format(*unannounced, self.token))
                unannounced = None
            if self._signal:
                self.board.note(stop=1)
            beat = self.board.beat_ns
            if (
                beat
                and time.perf_counter_ns() - beat > 1e9 * self.declared.timeout_s
                and self.board.state != State.ENDED
            ):
                main.kill()
                main.join()
                return [self._rescue(f"the stage did not answer for {self.declared.timeout_s:g} s")]
            for helper in beside:
                if not helper.keep():
                    self.board.say(f"the {helper.name} cannot be kept running")
                    self.board.note(stop=1)
        why = next(
            (event.partition("ramp to rest: ")[2] for event in self.board.said() if "ramp to rest: " in event), ""
        )
        if self.board.state != State.ENDED:
            return [self._rescue(why or "the loop's process died")]
        self._failed = why.startswith(("the stage failed", "nothing was measured"))
        return [f"The stage is at rest; {why}."]

    def _rescue(self, why: str) -> str:
        """Bring the stage to rest from outside; says what became of it."""
        self._failed = True
        left = quantity(float(self.board.drive[0]), self.declared.input_unit)
        if not self.declared.reopens:
            return (
                f"{why[0].upper()}{why[1:]}, and the stage cannot be opened by another process: its drive was "
                f"{left} at last."
            )
        ramp_s = (self.declared.x_limits[1] - self.declared.x_limits[0]) / self.declared.rate_limit
        process = self._start(loop.rescue, self.task)
        process.join(ramp_s + OPENING_S)
        if self.board.state == State.ENDED:
            return f"{why[0].upper()}{why[1:]}; another process has brought the stage to rest."
        process.kill()
        return f"{why[0].upper()}{why[1:]}, and the stage could not be brought to rest: its drive was {left} at last."

    def _finished(self, helper: Helper) -> str:
        """Make the recording's file of its stream."""
        assert self._record is not None
        if helper.process.exitcode != 0:  # it died at the very end
            helper.begin()
            helper.process.join(CLOSING_S)
        try:
            finish(self._record)
        except OSError as error:
            return (
                f"Recording: {stream_beside(self._record)}, since {self._record} could not be written: {error.strerror}"
            )
        return f"Recording: {self._record}"

    def _figures(self) -> list[str]:
        """What the run was like."""
        board, unit = self.board, self.declared.output_unit
        first, samples = board.read(0)
        edges = edges_us()

        def reached(counts: np.ndarray, share: float) -> float:
            return (
                float(edges[1 + int(np.searchsorted(np.cumsum(counts), share * counts.sum()))])
                if counts.sum()
                else math.nan
            )

        samples = samples[: max(0, (board.followed or board.head) - first)]
        samples = samples[-min(int(10 * self.task.rate), len(samples) // 2) or None :]  # without the way to it
        error = samples[:, 1] - samples[:, 3]
        error = error[np.isfinite(error)]
        rms = (
            [
                f"Tracking error over the last {error.size / self.task.rate:.3g} s: "
                f"{quantity(float(np.sqrt(np.mean(error**2))), unit, 3)} RMS."
            ]
            if error.size
            else []
        )
        return [
            *rms,
            f"{board.head} samples at {self.task.rate:g} Hz; service {reached(board.service, 0.5):.3g} µs at the "
            f"median and {reached(board.service, 0.999):.3g} µs at p99.9; {board.missed} deadlines were missed, and "
            f"{board.late_null} of {board.null_samples} by a loop that does nothing.",
        ]

    @contextmanager
    def _signals(self) -> Iterator[None]:
        """Have the signals that end a program end the run."""

        def note(number: int, frame: FrameType | None) -> None:
            self._signal = number

        numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        before = [signal.signal(number, note) for number in numbers]
        try:
            yield
        finally:
            for number, handler in zip(numbers, before, strict=True):
                signal.signal(number, handler)


def _loop(task: Task, ready: Any) -> None:
    loop.main(task, ready.send)
