"""The loop: at every sampling period write the drive, take what is measured, and count what that took, on an absolute
schedule.

Sample k is due at t_0 + k T. Service is the time from its begin to its end, response that from its due time; where the
response is above T the deadline was missed, and due times that have passed meanwhile are left out. Whatever the
compensator wants, the drive moves by at most rate · T a sample and stays inside the limits; in the end it ramps to
rest, however the end came.

The loop has a process of its own on a core of its own and waits for nobody: see `board`.
"""

import gc
import math
import os
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path

from bench.live.board import FOLLOW, Board, State, bin_of
from bench.live.controller import Controller
from bench.live.device import Device
from bench.live.task import Task
from bench.timing import cores
from bench.timing.schedule import SPIN_NS, wait_until

LEAD_NS = 20_000_000
NULL_S = 1.0
"""Of the null loop, which does nothing on the same schedule before the stage is opened."""
PRIORITY, WAKE_NS, SHORTEST_NS = 50, 40_000, 100_000
"""With real-time scheduling: its priority, how long before a due time the loop watches the clock, and the shortest
sampling period that leaves the system enough of the core, which otherwise stops such a loop for 50 ms of every
second."""
LOOK_AT_PARENT = 1_000
"""Samples between two looks whether the process that watches is still there."""
SHOW_S = 0.5
"""Between two times that the weights are shown."""


class Loop:
    """One run; ``controller`` is None where there is only the ramp to rest left, from the drive on the board."""

    def __init__(
        self, board: Board, device: Device, task: Task, controller: Controller | None, spin_ns: int = SPIN_NS
    ) -> None:
        self._board, self._device, self._task, self._controller = board, device, task, controller
        self._declared, self._spin_ns = task.declared, spin_ns
        self._y, self._set_point = math.nan, FOLLOW
        self._ramping = controller is None
        self._x = task.declared.rest if controller is not None else float(board.drive[0])
        self._silent = self._refused = 0

    def wanted(self, reference: float) -> float:
        """The drive of a sample: what the compensator wants, or rest, as far as limits and rate allow."""
        to, step = self._declared.rest, self._declared.rate_limit / self._task.rate
        if self._controller is not None:
            wanted = self._controller.step(reference, self._y)
            to = to if self._ramping or not math.isfinite(wanted) else wanted
        low, high = self._declared.x_limits
        return min(max(to, self._x - step, low), self._x + step, high)

    def exchange(self, x: float) -> None:
        """Write the drive and take what is measured; what fails ends the run, and the same drive is written again."""
        self._board.drive[0] = x  # before the stage has it: whoever goes on from here must not jump
        try:
            measured = self._device.exchange(x)
            if isinstance(measured, bool) or not hasattr(measured, "__float__"):
                raise TypeError(f"it returned {measured!r} and no number")
            self._x, self._y, self._refused = x, float(measured), 0
        except Exception as error:
            self._y, self._refused = math.nan, self._refused + 1
            self.end(f"the stage failed: {' '.join(str(error).split()) or type(error).__name__}", failed=True)
        self._silent = 0 if math.isfinite(self._y) else self._silent + 1
        if self._silent > self._declared.timeout_s * self._task.rate:
            self.end(f"nothing was measured for {self._declared.timeout_s:g} s", failed=True)

    def end(self, why: str, failed: bool = False) -> None:
        """Begin the ramp to rest, once."""
        if not self._ramping:
            self._ramping = True
            self._board.end(why, failed)

    def obey(self) -> None:
        """Do what the page asks for."""
        board, set_point = self._board, float(self._board.set_point[0])
        if set_point != self._set_point:
            self._set_point = set_point
            board.say(f"follows {self._task.reference.words}" if set_point == FOLLOW else f"holds {set_point:.6g}")
        if self._controller is not None and board.learning != self._controller.learning:
            self._controller.learning = bool(board.learning)
            board.say("learning" if board.learning else "learning waits")

    def run(self) -> bool:
        """Follow until the end, then ramp to rest; whether it is there, since a stage that takes no drive any more is
        given up."""
        board, rate, clock = self._board, self._task.rate, time.perf_counter_ns
        period, last = round(1e9 / rate), round(self._task.seconds * rate) or math.inf
        parent, start, k, written = os.getppid(), clock() + LEAD_NS, 0, board.head
        before, show_every = board.last[0] + 1.0 / rate if written else 0.0, max(1, round(SHOW_S * rate))
        while self._refused <= self._declared.timeout_s * rate:
            if board.stop or k >= last:
                self.end("the time is over" if k >= last else "asked to stop")
            if written % LOOK_AT_PARENT == 0 and os.getppid() != parent:
                self.end("the process that watches the loop has died")
            self.obey()
            due = start + k * period
            wait_until(due, clock, time.sleep, self._spin_ns)
            begin = clock()
            reference = self._task.reference.at(k) if self._set_point == FOLLOW else self._set_point
            self.exchange(
                float(board.drive[0]) if self._refused else self.wanted(reference)
            )  # it may have been taken after all
            end = clock()
            board.write(written, (before + k / rate, reference, self._x, self._y))
            board.note(beat_ns=end, missed=board.missed + (end - due > period))
            board.service[bin_of(end - begin)] += 1
            if self._ramping and self._x == self._declared.rest:
                return True
            written, k = written + 1, max(k + 1, (clock() - start) // period)
            if self._controller is not None and written % show_every == 0:
                self._controller.tell(board)
        return False


def real_time(rate: float) -> int:
    """Ask for real-time scheduling; how long before a due time to watch the clock, ns: a sleep ends late without it."""
    if 1e9 / rate < SHORTEST_NS:
        return SPIN_NS
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        return SPIN_NS
    return WAKE_NS


def null_loop(board: Board, rate: float, seconds: float, spin_ns: int) -> None:
    """What the machine does to a loop that does nothing."""
    period, clock = round(1e9 / rate), time.perf_counter_ns
    start, count = clock() + LEAD_NS, max(1, round(seconds * rate))
    late = 0
    for k in range(count):
        due = start + k * period
        wait_until(due, clock, time.sleep, spin_ns)
        late += clock() - due > period
    board.note(late_null=late, null_samples=count)


def main(task: Task, path: Path, ready: Callable[[str], None]) -> None:
    """The process of the loop; ``ready`` is told "" once the stage is open, or in a sentence why it is not."""
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # which a terminal sends to all; the process that watches says when to stop
    board, parent = Board(path, task.rate, task.model), os.getppid()
    signal.signal(signal.SIGTERM, lambda *_: board.note(stop=1))
    with cores.claim() as core:
        os.sched_setaffinity(0, {core.number})
        board.note(core=core.number)
        spin_ns = real_time(task.rate)
        null_loop(board, task.rate, NULL_S, spin_ns)
        device = task.device.make()
        loop = Loop(board, device, task, Controller(task), spin_ns)
        try:
            device.open()
        except Exception as error:
            ready(f"{task.device}: cannot be opened: {error}")
            return
        ready("")
        gc.collect()
        gc.disable()
        board.note(state=State.FOLLOWING, learning=int(task.learn != "off"))
        _end(board, device, loop.run())
    if os.getppid() != parent:  # nobody else is left to do it
        shutil.rmtree(path.parent, ignore_errors=True)


def rescue(task: Task, path: Path) -> None:
    """The process that brings a stage to rest whose loop could not: it opens the stage anew and ramps from where the
    drive was left."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    board, device = Board(path, task.rate, task.model), task.device.make()
    board.note(followed=board.followed or board.head)
    device.open()
    device.exchange(float(board.drive[0]))  # which the stage may have taken or not
    _end(board, device, Loop(board, device, task, None).run())


def _end(board: Board, device: Device, at_rest: bool) -> None:
    """Let go of the stage, and say that it is at rest."""
    device.close()
    if at_rest:
        board.note(state=State.ENDED)
