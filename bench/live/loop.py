"""The control loop: at every sampling period it writes the drive and reads the measured output, on an absolute
schedule.

Sample k is due at t_0 + k T. The service time is from the start of a sample to its end, the response time from its due
time to its end. If the response exceeds T, the deadline was missed, and the due times that have passed meanwhile are
skipped. The drive always changes by at most rate · T a sample and stays within the limits; every run ends with a ramp
to rest.

The loop has a process and a core of its own and waits for no other process: see `board`.
"""

import gc
import math
import os
import signal
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection

from bench.live.board import FOLLOW, Board, State, bin_of
from bench.live.controller import Controller
from bench.live.device import Device
from bench.live.task import Task
from bench.timing import cores
from bench.timing.schedule import SPIN_NS, wait_until

LEAD_NS = 20_000_000
"""From the start of a schedule to its first due time."""
NULL_S = 1.0
"""Length of the null loop, which does nothing on the same schedule before the stage is opened."""
PRIORITY, WAKE_NS, SHORTEST_NS = 50, 40_000, 100_000
"""Real-time scheduling: priority, how long before a due time the loop begins to spin, and the shortest sampling period
that leaves the system enough of the core; with a shorter one, Linux would stop the loop for 50 ms of every second."""
CHECK_PARENT = 1_000
"""Samples between checks that the parent process is alive."""
SHOW_S = 0.5
"""Interval at which the model is shown."""


def schedule(rate: float, spin_ns: int) -> Iterator[tuple[int, int]]:
    """Wait for each sample and yield its number and due time, ns; due times that have passed are skipped."""
    period, clock = round(1e9 / rate), time.perf_counter_ns
    start, k = clock() + LEAD_NS, 0
    while True:
        wait_until(start + k * period, clock, time.sleep, spin_ns)
        yield k, start + k * period
        k = max(k + 1, (clock() - start) // period)


class Loop:
    """One run from the drive on the board; if the board's state is RAMPING, only the ramp to rest."""

    def __init__(self, board: Board, device: Device, task: Task, spin_ns: int = SPIN_NS) -> None:
        self._board, self._device, self._task, self._spin_ns = board, device, task, spin_ns
        self._controller = Controller(task)
        self._x, self._y, self._set_point = float(board.drive[0]), math.nan, FOLLOW
        self._ramping = board.state == State.RAMPING
        self._silent = self._failures = 0

    def next_drive(self, reference: float) -> float:
        """The drive that the compensator requests, or rest, within limits and rate."""
        stage, requested = self._task.declared, self._controller.step(reference, self._y)
        target = stage.rest if self._ramping or not math.isfinite(requested) else requested
        (low, high), step = stage.x_limits, stage.rate_limit / self._task.rate
        return min(max(target, self._x - step, low), self._x + step, high)

    def exchange(self, x: float) -> None:
        """Write the drive and read the output; a failure ends the run, and the same drive is written again."""
        self._board.drive[0] = x  # before the stage has it: a rescue must not jump
        try:
            measured = self._device.exchange(x)
            if isinstance(measured, bool) or not hasattr(measured, "__float__"):
                raise TypeError(f"it returned {measured!r} and no number")
            self._x, self._y, self._failures = x, float(measured), 0
        except Exception as error:
            self._y, self._failures = math.nan, self._failures + 1
            self.end(f"the stage failed: {' '.join(str(error).split()) or type(error).__name__}", failed=True)
        self._silent = 0 if math.isfinite(self._y) else self._silent + 1
        if self._silent > self._task.timeout_samples:
            self.end(f"no measurement for {self._task.declared.timeout_s:g} s", failed=True)

    def end(self, reason: str, failed: bool = False) -> None:
        """Begin the ramp to rest, unless it has begun."""
        if not self._ramping:
            self._ramping = True
            self._board.begin_ramp(reason, failed)

    def obey(self) -> None:
        """Carry out the requests on the board."""
        board, set_point = self._board, float(self._board.set_point[0])
        if board.stop:
            self.end("asked to stop")
        if set_point != self._set_point:
            self._set_point = set_point
            board.log(f"follows {self._task.reference.words}" if set_point == FOLLOW else f"holds {set_point:.6g}")
        if board.learning != self._controller.learning:
            self._controller.learning = bool(board.learning)
            board.log("learning" if board.learning else "learning paused")

    def run(self) -> bool:
        """Follow the reference until the end, then ramp to rest; False if the stage takes no drive any more."""
        board, rate, parent = self._board, self._task.rate, os.getppid()
        last, show_every = round(self._task.seconds * rate) or math.inf, max(1, round(SHOW_S * rate))
        before = board.last[0] + 1.0 / rate if board.head else 0.0
        for k, due in schedule(rate, self._spin_ns):
            if k >= last:
                self.end("the time is over")
            start = time.perf_counter_ns()
            reference = self._task.reference.at(k) if self._set_point == FOLLOW else self._set_point
            # a drive whose exchange failed is written again: the stage may have taken it
            self.exchange(float(board.drive[0]) if self._failures else self.next_drive(reference))
            end = time.perf_counter_ns()
            board.write((before + k / rate, reference, self._x, self._y))
            board.set(beat_ns=end, missed=board.missed + (end - due > 1e9 / rate))
            board.service[bin_of(end - start)] += 1
            if self._ramping and self._x == self._task.declared.rest:
                return True
            if self._failures > self._task.timeout_samples:
                break
            if board.head % CHECK_PARENT == 0 and os.getppid() != parent:
                self.end("the process that watches the loop has died")
            if not self._ramping:
                self.obey()
                if board.head % show_every == 0:
                    self._controller.show(board)
        return False


def real_time(rate: float) -> int:
    """Request real-time scheduling; return how long before a due time to spin, ns: without it, sleeps end late."""
    if 1e9 / rate < SHORTEST_NS:
        return SPIN_NS
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        return SPIN_NS
    return WAKE_NS


def null_loop(board: Board, rate: float, spin_ns: int) -> None:
    """Count the deadlines that a loop that does nothing misses on this machine."""
    samples = missed = 0
    for k, due in schedule(rate, spin_ns):
        if k >= NULL_S * rate:
            break
        samples, missed = samples + 1, missed + (time.perf_counter_ns() - due > 1e9 / rate)
    board.set(null_missed=missed, null_samples=samples)


def main(task: Task, board: Board, ready: Connection) -> None:
    """Process of the loop; sends "" once the stage is open, or a sentence why it is not."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all processes; the parent requests the stop
    signal.signal(signal.SIGTERM, lambda *_: board.set(stop=1))
    with cores.claim() as core:
        os.sched_setaffinity(0, {core.number})
        board.set(core=core.number)
        spin_ns = real_time(task.rate)
        null_loop(board, task.rate, spin_ns)
        board.drive[0] = task.declared.rest
        device = task.device.make()
        loop = Loop(board, device, task, spin_ns)
        try:
            device.open()
        except Exception as error:
            ready.send(f"{task.device}: cannot be opened: {error}")
            return
        ready.send("")
        gc.collect()
        gc.disable()
        board.set(state=State.FOLLOWING, learning=int(task.learn != "off"))
        _finish(board, device, loop)


def rescue(task: Task, board: Board) -> None:
    """Process that takes over from a loop that died or hangs: it opens the stage anew and ramps it to rest from the
    last drive."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    device = task.device.make()
    board.set(followed=board.followed or board.head, state=State.RAMPING)
    device.open()
    device.exchange(float(board.drive[0]))  # the stage may have taken it or not
    _finish(board, device, Loop(board, device, task))


def _finish(board: Board, device: Device, loop: Loop) -> None:
    """Run the loop and close the stage."""
    at_rest = loop.run()
    device.close()
    if at_rest:
        board.set(state=State.ENDED)
