"""The two processes of a run, from top to bottom: whatever ends the run, the stage comes to rest.

The process of the loop opens the stage, whose drive is at rest, and follows the reference: at every sampling period it
writes the drive and reads the measured output, on an absolute schedule. If the time is over, somebody asks for it, the
command dies, the stage or the compensator fails, or the sensor is silent for ``timeout_s``, the drive ramps to rest at
the stage's rate limit. While it calls the stage, a timer of the kernel runs (SIGALRM), which ends the process if the
call takes longer than the stage may, whatever the call is doing and whoever else is alive.

The process that stands by waits for the end of the first one, which no other process and no signal keeps it from. If
the stage is not at rest then, since the timer or somebody else has ended that process, or the stage took no drive for
``timeout_s``, it opens the stage anew, writes the last drive again, which the stage may have taken or not, and ramps to
rest from there, on the same schedule and with the same timer. A stage that cannot be opened twice is left as it is.

Sample k is due at t_0 + k T. The service time is from the start of a sample to its end, the response time from its due
time to its end. If the response exceeds T, the deadline was missed; the due times that have passed meanwhile are
skipped, and each is a missed deadline too. The drive always changes by at most rate · T a sample and stays within the
limits. The loop waits for no other process: see `board`.
"""

import gc
import math
import os
import signal
import time
from bisect import bisect
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.connection import wait
from typing import Any

from bench.live.board import EDGES_US, FOLLOW, LONGEST, Board, State
from bench.live.settings import LiveSettings
from bench.timing.schedule import SPIN_NS, schedule
from piezo_model import Compensator, SelfLearningCompensator
from piezo_model.recordings.table import first_line
from piezo_model.units import quantity

PRIORITY, WAKE_NS = 50, 40_000
"""Real-time scheduling: priority, and how long before a due time the loop begins to spin. Some of each period must be
left to the system, which would stop the loop for 50 ms of every second otherwise."""
OPENING_S, CLOSING_S = 60.0, 10.0
"""Longest times in which a stage may open and close."""
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a run; they are blocked while a process of the run starts."""
SHOW_S = 0.5
"""Interval at which events of learning are shown."""
TIME_OVER, STOP_REQUESTED = "the time is over", "asked to stop"
"""Why a run ends if nothing has failed."""


def main(settings: LiveSettings, board: Board, core: int, lock: object) -> None:
    """Run the process of the loop, on a core of its own as long as it has its lock."""
    handle_signals(lambda *_: setattr(board, "stop", 1))
    os.sched_setaffinity(0, {core})
    with suppress(PermissionError):  # then sleeps end late, and it spins for longer
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    # what a loop that does nothing misses in a second
    for _, due, skipped in due_times(settings.rate, round(settings.rate)):
        board.null_missed += skipped + (time.perf_counter_ns() - due > 1e9 / settings.rate)
    board.drive = settings.declared.rest
    run_stage(settings, board, settings.compensator())


def stand_by(settings: LiveSettings, board: Board, loop: int) -> None:
    """Run the process that stands by, given the process id of the loop."""
    handle_signals(signal.SIG_IGN)
    with suppress(ProcessLookupError):  # it has ended already
        wait([os.pidfd_open(loop)])
    if settings.declared.reopens and board.state in (State.FOLLOWING, State.RAMPING_TO_REST):
        board.followed = board.followed or board.head
        run_stage(settings, board)


def run_stage(
    settings: LiveSettings, board: Board, compensator: Compensator | SelfLearningCompensator | None = None
) -> None:
    """Open the stage, run the loop and close the stage; the board's reason says what cannot be done."""
    signal.setitimer(signal.ITIMER_REAL, OPENING_S)
    done = "opened"
    try:
        stage = settings.make()
        stage.open()
        done = "closed"
        gc.collect()
        gc.disable()
        board.state = State.FOLLOWING if compensator else State.RAMPING_TO_REST
        loop = Loop(settings, board, stage, compensator)
        try:
            loop.run()
        except Exception as error:  # of the compensator, which the ramp to rest does not need
            loop.end(f"the loop failed: {first_line(error)}")
            loop.run()
        signal.setitimer(signal.ITIMER_REAL, CLOSING_S)
        stage.close()
    except (Exception, SystemExit) as error:
        board.reason = f"{board.reason}; it cannot be {done}: {first_line(error)}".removeprefix("; ")[:LONGEST]


class Loop:
    """Drives an open stage from the drive on the board until it is at rest; without a compensator it only ramps."""

    def __init__(
        self,
        settings: LiveSettings,
        board: Board,
        stage: Any,
        compensator: Compensator | SelfLearningCompensator | None,
    ) -> None:
        self._settings, self._board, self._stage = settings, board, stage
        self._compensator, self._y, self._set_point = compensator, math.nan, FOLLOW
        self._silent_ns = 0
        """Since when the sensor has been silent; 0 if it is not."""
        self._failing_ns = 0 if compensator else time.perf_counter_ns()
        """Since when the stage has not answered, or not this process; 0 if it does."""

    def run(self) -> None:
        """Follow the reference until the end, then ramp to rest, which the board's state says if the stage is there; it
        is not if it takes no drive any more."""
        board, rate, limit_s = self._board, self._settings.rate, self._settings.limit_s
        before = board.last[0] + 1.0 / rate if board.head else 0.0
        for k, due, skipped in due_times(rate):
            signal.setitimer(signal.ITIMER_REAL, limit_s)
            if board.state == State.FOLLOWING:
                self.obey(k)
            start = time.perf_counter_ns()
            reference = self._settings.reference
            y_ref = float(reference[k % reference.size]) if self._set_point == FOLLOW else self._set_point
            self.exchange(self.next_drive(y_ref))
            end = time.perf_counter_ns()
            board.write((before + k / rate, y_ref, board.drive, self._y))
            board.missed += skipped + (end - due > 1e9 / rate)
            board.service[bisect(EDGES_US, 1e-3 * (end - start))] += 1
            if (
                board.state == State.RAMPING_TO_REST
                and not self._failing_ns
                and board.drive == self._settings.declared.rest
            ):
                board.state = State.AT_REST if self._compensator else State.BROUGHT_TO_REST
                break
            if self._failing_ns and end - self._failing_ns > 1e9 * limit_s:
                break
            if board.head % math.ceil(SHOW_S * rate) == 0:
                self.show()

    def obey(self, k: int) -> None:
        """End the run if it is over at sample k, and follow the set point of the board."""
        board, settings = self._board, self._settings
        if 0.0 < settings.seconds * settings.rate <= k:
            self.end(TIME_OVER)
        if os.getppid() != settings.command:
            self.end("the process that watches the loop has died")
        if board.stop:
            self.end(STOP_REQUESTED)
        if board.set_point != self._set_point:
            self._set_point = board.set_point
            level = quantity(self._set_point, settings.declared.output_unit, 6)
            board.log(f"follows {settings.words}" if self._set_point == FOLLOW else f"holds {level}")

    def end(self, reason: str) -> None:
        """Begin the ramp to rest, unless it has begun."""
        board = self._board
        if board.state == State.FOLLOWING:
            board.log(f"ramp to rest: {reason}")
            board.reason, board.followed, board.state = reason[:LONGEST], board.head, State.RAMPING_TO_REST

    def next_drive(self, y_ref: float) -> float:
        """The drive that the compensator requests, which keeps the limits and began at rest, or rest as far as the rate
        limit allows."""
        if self._compensator and self._board.state == State.FOLLOWING:
            if isinstance(self._compensator, SelfLearningCompensator):
                return self._compensator.step(y_ref, self._y)
            self._compensator.correct(self._y)
            return self._compensator.step(y_ref)
        declared, x = self._settings.declared, self._board.drive
        # a stage that does not answer may have taken the last drive, or not
        step = 0.0 if self._failing_ns else declared.rate_limit / self._settings.rate
        return min(max(declared.rest, x - step), x + step)

    def exchange(self, x: float) -> None:
        """Write the drive and read the output; a failure ends the run, and so does a silent sensor."""
        self._board.drive, self._y = x, math.nan  # before the stage has it: a rescue must not jump
        try:
            measured = self._stage.exchange(x)
            if isinstance(measured, bool) or not hasattr(measured, "__float__"):
                raise TypeError(f"it returned {measured!r} and no number")
            self._y, self._failing_ns = float(measured), 0
        except (Exception, SystemExit) as error:
            self._failing_ns = self._failing_ns or time.perf_counter_ns()
            self.end(f"the stage failed: {first_line(error)}")
        now = time.perf_counter_ns()
        self._silent_ns = 0 if math.isfinite(self._y) else self._silent_ns or now
        if self._silent_ns and now - self._silent_ns > 1e9 * self._settings.limit_s:
            self.end(f"no measurement for {self._settings.declared.timeout_s:g} s")

    def show(self) -> None:
        """Show what has been learned."""
        if isinstance(self._compensator, SelfLearningCompensator):
            self._board.hand_overs, log = self._compensator.counts["hand_overs"], self._compensator.log
            while log:
                event = log.popleft()
                self._board.log(f"{event.what}: {event.message}")


def due_times(rate: float, samples: float = math.inf) -> Iterator[tuple[int, int, int]]:
    """The schedule of a sampling rate."""
    in_time = os.sched_getscheduler(0) == os.SCHED_FIFO
    return schedule(round(1e9 / rate), samples, spin_ns=WAKE_NS if in_time else SPIN_NS)


def handle_signals(handler: Callable[..., object] | signal.Handlers) -> None:
    """Handle the signals that end a run, but those that the caller ignores, as nohup does.

    A stage stands still while its loop is stopped, so Ctrl-Z has no effect.
    """
    for number in [number for number in ENDING if signal.getsignal(number) != signal.SIG_IGN]:
        signal.signal(number, handler)
    signal.signal(signal.SIGTSTP, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
