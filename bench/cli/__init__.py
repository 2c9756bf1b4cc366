"""The ``piezobench`` command; each file holds a group of verbs.

A user's mistake ends in one sentence on standard error and exit status 2, without a traceback. Exit status 1 means a
fault of the program itself.
"""

import atexit
import os
import signal
import sys
from types import FrameType

from bench.cli import standard_streams

REFUSED = 2
"""Exit status after a user's mistake."""
FAILED = 3
"""Exit status of a comparison, or a history, that found what its options name."""
INTERRUPTED = 128 + signal.SIGINT
"""Exit status after Ctrl-C, as in shells: 128 plus the number of the signal."""


def main() -> None:
    """Run the command line.

    The verbs are imported inside this function, because every child process of a race imports its parent's script again
    and does not need them.
    """
    if sys.platform != "linux":
        print("piezobench: Linux only; on this system the library works from Python: piezo_model", file=sys.stderr)
        sys.exit(REFUSED)
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, _end)
    status = 1  # after a traceback

    def leave() -> None:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:  # None if the caller closed its descriptor
                stream.flush()
        os._exit(status)

    atexit.register(leave)  # runs last, and skips the second that the libraries' own clean-up takes
    try:
        standard_streams.prepare()
        from bench.cli.app import run
    except (standard_streams.OutputError, ModuleNotFoundError) as error:
        absent = f"the command needs the package {getattr(error, 'name', '')}: install piezobench[bench]"
        print(f"piezobench: {absent if isinstance(error, ImportError) else error}", file=sys.stderr)
        status = REFUSED
    else:
        status = run(sys.argv[1:])
    sys.exit(status)


def _end(number: int, frame: FrameType | None) -> None:
    """End at once: during the imports there is nothing to tidy up, and many libraries mistake an interrupt for an error
    of their own."""
    os._exit(INTERRUPTED)
