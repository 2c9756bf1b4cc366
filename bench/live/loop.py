"""The loop: at every sampling period write the drive, take what is measured, and count what that took, on an absolute schedule.

Sample k is due at t_0 + k T. Service is the time from its begin to its end, response that from its due time; where the response is above T
the deadline was missed, and due times that have passed meanwhile are left out. Whatever the compensator wants, the drive moves by at most
rate · T a sample and stays inside the limits; in the end it ramps to rest, however the end came.

The loop has a process of its own on a core of its own and waits for nobody: see `board`.
"""

from __future__ import annotations

import gc
import math
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bench.live.board import Board, Command, State, bin_of
from bench.live.controller import Controller, Plan
from bench.live.device import Declared, Device, DeviceFile, Simulated
from bench.live.reference import Reference, constant
from bench.timing import cores
from bench.timing.schedule import wait_until

LEAD_NS = 20_000_000
NULL_S = 1.0
"""Of the null loop, which does nothing on the same schedule before the stage is opened."""
LOOK_AT_PARENT = 1_000
"""Samples between two looks whether the process that watches is still there."""


@dataclass(frozen=True)
class Task:
    """What a loop is to do; it can be sent to its process."""

    board: Path
    device: DeviceFile | Simulated
    plan: Plan
    reference: Reference
    rate: float
    seconds: float


class Loop:
    """One run."""

    def __init__(self, board: Board, device: Device, declared: Declared, controller: Controller, task: Task) -> None:
        self._board, self._device, self._declared, self._controller, self._task = (
            board,
            device,
            declared,
            controller,
            task,
        )
        self._reference: Reference = task.reference
        self._x, self._y = declared.rest, math.nan
        self._step = declared.rate_limit / task.rate
        self._seen, self._silent_since, self._state = 0, -1, State.FOLLOWING

    def drive(self, k: int) -> float:
        """The reference of sample k, followed as far as limits, rate and state allow."""
        reference = self._reference.at(k)
        wanted = self._controller.step(reference, self._y) if self._state is State.FOLLOWING else self._declared.rest
        low, high = self._declared.x_limits
        self._x = min(
            max(wanted if math.isfinite(wanted) else self._x, self._x - self._step, low), self._x + self._step, high
        )
        return reference

    def exchange(self, k: int) -> None:
        """Write the drive and take what is measured; what fails ends the run."""
        self._board.drive[0] = self._x  # before the stage has it: whoever goes on from here must not jump
        try:
            measured = self._device.exchange(self._x)
            if isinstance(measured, bool) or not hasattr(measured, "__float__"):
                raise TypeError(f"it returned {measured!r} and no number")
            self._y = float(measured)
        except Exception as error:
            self._y = math.nan
            self._board.note(unwritten=self._board.unwritten + 1)
            self.end(f"the stage failed: {' '.join(str(error).split()) or type(error).__name__}")
        if math.isfinite(self._y):
            self._silent_since = -1
        elif self._silent_since < 0:
            self._silent_since = k
        elif k - self._silent_since > self._declared.timeout_s * self._task.rate:
            self.end(f"nothing was measured for {self._declared.timeout_s:g} s")

    def end(self, why: str) -> None:
        """Begin the ramp to rest, once."""
        if self._state is State.FOLLOWING:
            self._state = State.RAMPING
            self._board.note(state=State.RAMPING)
            self._board.say(f"ramp to rest: {why}")

    def obey(self, k: int) -> None:
        """Take what was asked for."""
        for command, value in self._board.asked(self._seen):
            self._seen += 1
            if command is Command.STOP:
                self.end("asked to stop")
            elif command is Command.LEARN:
                self._controller.learning = bool(value)
                self._board.note(learning=int(value))
                self._board.say("learning" if value else "learning waits")
            elif command is Command.FOLLOW:
                self._reference = self._task.reference
                self._board.say(f"follows {self._reference.words}")
            else:
                low, high = self._declared.y_range
                at = self._reference.at(k) if command is Command.HOLD else value
                if math.isfinite(at):
                    self._reference = constant(min(max(at, low), high))
                    self._board.say(f"holds {self._reference.at(0):.6g}")

    def run(self) -> None:
        """Follow until the end, then ramp to rest."""
        board, period = self._board, round(1e9 / self._task.rate)
        clock, last = (
            time.perf_counter_ns,
            math.inf if self._task.seconds <= 0.0 else round(self._task.seconds * self._task.rate),
        )
        parent, start, k, written = os.getppid(), clock() + LEAD_NS, 0, 0
        board.note(state=State.FOLLOWING, learning=int(self._controller.learning))
        while self._state is State.FOLLOWING or self._x != self._declared.rest:
            if board.stop or k >= last:
                self.end("the time is over" if k >= last else "asked to stop")
            if written % LOOK_AT_PARENT == 0 and os.getppid() != parent:
                self.end("the process that watches the loop has died")
            if board.commands > self._seen:
                self.obey(k)
            due = start + k * period
            wait_until(due, clock, time.sleep)
            begin = clock()
            reference = self.drive(k)
            self.exchange(k)
            end = clock()
            board.write(written, (k / self._task.rate, reference, self._x, self._y))
            written += 1
            board.service[bin_of(end - begin)] += 1
            board.response[bin_of(end - due)] += 1
            board.note(beat_ns=end, missed=board.missed + (end - due > period))
            if self._controller.tell(board):
                board.note(hand_overs=self._controller.hand_overs)
            k = max(k + 1, (clock() - start) // period)


def null_loop(board: Board, rate: float, seconds: float) -> None:
    """What the machine does to a loop that does nothing."""
    period, clock = round(1e9 / rate), time.perf_counter_ns
    start, count = clock() + LEAD_NS, max(1, round(seconds * rate))
    late = 0
    for k in range(count):
        wait_until(start + k * period, clock, time.sleep)
        response = clock() - start - k * period
        board.null[bin_of(response)] += 1
        late += response > period
    board.note(late_null=late, null_samples=count)


def main(task: Task, ready: Callable[[str], None]) -> None:
    """The process of the loop; ``ready`` is told "" once the stage is open, or in a sentence why it is not."""
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # which a terminal sends to all; the process that watches says when to stop
    board = Board(task.board, task.rate)
    signal.signal(signal.SIGTERM, lambda *_: board.note(stop=1))
    with cores.claim() as core:
        os.sched_setaffinity(0, {core.number})
        board.note(core=core.number)
        null_loop(board, task.rate, NULL_S)
        device = task.device.make()
        declared = Declared.of(device, str(task.device))
        controller = Controller.of(task.plan, declared, 1.0 / task.rate)
        try:
            device.open()
        except Exception as error:
            ready(f"{task.device}: cannot be opened: {error}")
            return
        ready("")
        gc.collect()
        gc.disable()
        try:
            Loop(board, device, declared, controller, task).run()
        finally:
            device.close()
            board.note(state=State.ENDED)


def rescue(task: Task) -> None:
    """The process that brings a stage to rest whose loop has died: it opens the stage anew and ramps from where the drive was left."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    board, device = Board(task.board, task.rate), task.device.make()
    declared = Declared.of(device, str(task.device))
    step, period, clock = declared.rate_limit / task.rate, round(1e9 / task.rate), time.perf_counter_ns
    device.open()
    last = board.read(board.head - 1)[1][-1, 0] if board.head else 0.0
    first, start, x, k = board.head, clock() + LEAD_NS, float(board.drive[0]), 0
    while True:
        wait_until(start + k * period, clock, time.sleep)
        board.drive[0] = x
        measured = device.exchange(x)
        board.write(first + k, (last + (k + 1) / task.rate, declared.rest, x, measured))
        board.note(beat_ns=clock())
        if x == declared.rest:
            break
        x, k = min(max(declared.rest, x - step), x + step), k + 1
    device.close()
