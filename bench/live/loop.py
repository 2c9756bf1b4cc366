"""The control loop: at every sampling period it writes the drive and reads the measured output, on an absolute
schedule.

Sample k is due at t_0 + k T. The service time is from the start of a sample to its end, the response time from its due
time to its end. If the response exceeds T, the deadline was missed; the due times that have passed meanwhile are
skipped, and each is a missed deadline too. The drive always changes by at most rate · T a sample and stays within the
limits; every run ends with a ramp to rest.

The loop has a process and a core of its own and waits for no other process: see `board`. While it calls the stage a
timer of the kernel runs (SIGALRM), which ends the process if the call takes longer than the stage may, whatever the
call is doing and whoever else is alive. Another process, which has been waiting for that, opens the stage anew and
ramps it to rest: :func:`stand_by`.
"""

import gc
import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.connection import wait

from bench.live.board import FOLLOW, Board, State, bin_of
from bench.live.controller import Controller
from bench.live.device import Device
from bench.live.settings import LiveSettings
from bench.timing import cores
from bench.timing.schedule import SPIN_NS, wait_until
from piezo_model.units import quantity

LEAD_NS = 20_000_000
"""From the start of a schedule to its first due time."""
NULL_S = 1.0
"""Length of the null loop, which does nothing on the same schedule before the stage is opened."""
PRIORITY, WAKE_NS, SHORTEST_NS = 50, 40_000, 100_000
"""Real-time scheduling: priority, how long before a due time the loop begins to spin, and the shortest sampling period
that leaves the system enough of the core; with a shorter one, Linux would stop the loop for 50 ms of every second."""
OPENING_S, CLOSING_S = 60.0, 10.0
"""Longest times in which a stage may open and close."""
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a run; they are blocked while a process of the run starts."""
SHOW_S = 0.5
"""Interval at which events of learning are shown."""


def schedule(rate: float, spin_ns: int) -> Iterator[tuple[int, int, int]]:
    """Wait for each sample and yield its number, its due time in ns, and how many due times were skipped before it,
    because they had passed."""
    period, clock = round(1e9 / rate), time.perf_counter_ns
    start, k, skipped = clock() + LEAD_NS, 0, 0
    while True:
        wait_until(start + k * period, clock, time.sleep, spin_ns)
        yield k, start + k * period, skipped
        newest = max(k + 1, (clock() - start) // period)
        k, skipped = newest, newest - k - 1


def handle_signals(handler: Callable[..., object] | signal.Handlers) -> None:
    """Handle the signals that end a run, but those that the caller ignores, as nohup does.

    A stage stands still while its loop is stopped, so Ctrl-Z has no effect.
    """
    for number in [number for number in ENDING if signal.getsignal(number) != signal.SIG_IGN]:
        signal.signal(number, handler)
    signal.signal(signal.SIGTSTP, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)


class Loop:
    """One run from the drive on the board; if the board's state is RAMPING, only the ramp to rest."""

    def __init__(self, board: Board, device: Device, settings: LiveSettings, spin_ns: int = SPIN_NS) -> None:
        self._board, self._device, self._settings, self._spin_ns = board, device, settings, spin_ns
        self._controller = Controller(settings)
        self._x, self._y, self._set_point = float(board.drive[0]), math.nan, FOLLOW
        self._ramping, self._answered_ns, self._measured_ns = board.state == State.RAMPING, 0, 0

    def next_drive(self, reference: float) -> float:
        """The drive that the compensator requests, or rest, within limits and rate."""
        stage, requested = (
            self._settings.declared,
            math.nan if self._ramping else self._controller.step(reference, self._y),
        )
        target = requested if math.isfinite(requested) else stage.rest
        (low, high), step = stage.x_limits, stage.rate_limit / self._settings.rate
        return min(max(target, self._x - step, low), self._x + step, high)

    def exchange(self, x: float) -> None:
        """Write the drive and read the output; a failure ends the run, and the same drive is written again."""
        self._board.drive[0] = x  # before the stage has it: a rescue must not jump
        try:
            measured = self._device.exchange(x)
            if isinstance(measured, bool) or not hasattr(measured, "__float__"):
                raise TypeError(f"it returned {measured!r} and no number")
            self._x, self._y, self._answered_ns = x, float(measured), time.perf_counter_ns()
        except (Exception, SystemExit) as error:
            self._y = math.nan
            self.end(f"the stage failed: {words_of(error)}", failed=True)
        if math.isfinite(self._y):
            self._measured_ns = self._answered_ns
        elif time.perf_counter_ns() - self._measured_ns > 1e9 * self._settings.limit_s:
            self.end(f"no measurement for {self._settings.declared.timeout_s:g} s", failed=True)

    def end(self, reason: str, failed: bool = False) -> None:
        """Begin the ramp to rest, unless it has begun."""
        if not self._ramping:
            self._ramping, self._board.reason = True, reason
            self._board.log(f"ramp to rest: {reason}")
            self._board.set(followed=self._board.head, failed=failed, state=State.RAMPING)

    def obey(self) -> None:
        """Carry out the requests on the board."""
        board, set_point = self._board, float(self._board.set_point[0])
        if board.stop:
            self.end("asked to stop")
        if set_point != self._set_point:
            self._set_point = set_point
            board.log(
                f"follows {self._settings.reference.words}"
                if set_point == FOLLOW
                else f"holds {quantity(set_point, self._settings.declared.output_unit, 6)}"
            )

    def run(self) -> None:
        """Follow the reference until the end, then ramp to rest; the board's state is ENDED unless the stage takes no
        drive any more."""
        board, rate = self._board, self._settings.rate
        last, show_every = self._settings.seconds * rate or math.inf, max(1, round(SHOW_S * rate))
        before = board.last[0] + 1.0 / rate if board.head else 0.0
        self._answered_ns = self._measured_ns = time.perf_counter_ns() + LEAD_NS
        for k, due, skipped in schedule(rate, self._spin_ns):
            signal.setitimer(signal.ITIMER_REAL, self._settings.limit_s)
            if k >= last:
                self.end("the time is over")
            if is_orphan():
                self.end("the process that watches the loop has died")
            if not self._ramping:
                self.obey()
            start = time.perf_counter_ns()
            reference = self._settings.reference.at(k) if self._set_point == FOLLOW else self._set_point
            # a drive whose exchange failed is written again: the stage may have taken it
            self.exchange(self.next_drive(reference) if board.drive[0] == self._x else float(board.drive[0]))
            end = time.perf_counter_ns()
            board.write((before + k / rate, reference, self._x, self._y))
            board.set(missed=board.missed + skipped + (end - due > 1e9 / rate))
            board.service[bin_of(end - start)] += 1
            # the stage may have taken a drive that it did not answer
            if self._ramping and self._x == board.drive[0] == self._settings.declared.rest:
                board.set(state=State.ENDED)
                break
            if end - self._answered_ns > 1e9 * self._settings.limit_s:
                break
            if not self._ramping and board.head % show_every == 0:
                self._controller.show(board)


def is_orphan() -> bool:
    """Whether the process that started this one has died."""
    parent = multiprocessing.parent_process()
    return parent is not None and os.getppid() != parent.pid


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
    for k, due, skipped in schedule(rate, spin_ns):
        if k >= NULL_S * rate:
            break
        samples, missed = samples + 1, missed + skipped + (time.perf_counter_ns() - due > 1e9 / rate)
    board.set(null_missed=missed, null_samples=samples)


def main(settings: LiveSettings, board: Board) -> None:
    """Process of the loop, which has a core of its own until it ends."""
    handle_signals(lambda *_: board.set(stop=1))
    core = cores.claim()
    if is_orphan():  # while it waited for the core
        return
    board.set(core=core.number)
    os.sched_setaffinity(0, {core.number})
    spin_ns = real_time(settings.rate)
    null_loop(board, settings.rate, spin_ns)
    board.drive[0] = settings.declared.rest
    _drive(settings, board, spin_ns)


def stand_by(settings: LiveSettings, board: Board, loop: int) -> None:
    """Process that waits for the end of the loop, whose process id is given; if the stage is not at rest then, it opens
    it anew and ramps it to rest from the last drive."""
    handle_signals(signal.SIG_IGN)
    with suppress(ProcessLookupError):  # it has ended already
        wait([os.pidfd_open(loop)])
    if board.state in (State.FOLLOWING, State.RAMPING):
        board.set(followed=board.followed or board.head, state=State.RAMPING, rescued=1)
        _drive(settings, board, SPIN_NS)


def _drive(settings: LiveSettings, board: Board, spin_ns: int) -> None:
    """Open the stage, run the loop and close the stage; the board's reason says what cannot be done.

    The state is STARTING until the stage is open, or RAMPING from the start.
    """
    signal.setitimer(signal.ITIMER_REAL, OPENING_S)
    done = "opened"
    try:
        device = settings.device.make()
        loop = Loop(board, device, settings, spin_ns)
        device.open()
        done = "closed"
        gc.collect()
        gc.disable()
        if board.state == State.STARTING:
            board.set(state=State.FOLLOWING)
        else:
            device.exchange(float(board.drive[0]))  # the stage may have taken it or not
        try:
            loop.run()
        except Exception as error:  # of the compensator, which the ramp to rest does not need
            loop.end(f"the loop failed: {words_of(error)}", failed=True)
            loop.run()
        signal.setitimer(signal.ITIMER_REAL, CLOSING_S)
        device.close()
    except (Exception, SystemExit) as error:
        board.set(failed=1)
        board.reason = f"{board.reason}; it cannot be {done}: {words_of(error)}".removeprefix("; ")


def words_of(error: BaseException) -> str:
    """The message of an exception on one line, or its name."""
    return " ".join(str(error).split()) or type(error).__name__
