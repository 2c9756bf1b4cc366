"""The process that stands by: it waits for the end of the loop's process, which no other process and no signal keeps it
from, and brings the stage to rest if the loop has not.

It opens the stage anew, writes the last drive of the loop again, which the stage may have taken or not, and ramps to
rest from there, on the schedule and with the timer of the loop. A stage that cannot be opened twice is left as it is.
"""

import os
import signal
from contextlib import suppress
from multiprocessing.connection import wait

from bench.live.board import Board, State
from bench.live.loop import handle_signals, run_stage
from bench.live.settings import LiveSettings


def main(settings: LiveSettings, board: Board, loop: int) -> None:
    """Run the process, given the process id of the loop."""
    handle_signals(signal.SIG_IGN)
    with suppress(ProcessLookupError):  # it has ended already
        wait([os.pidfd_open(loop)])
    if settings.declared.reopens and board.state in (State.FOLLOWING, State.RAMPING_TO_REST):
        board.followed = board.followed or board.head
        run_stage(settings, board)
