"""The ``piezobench`` command: one file a group of verbs.

Whatever a user can get wrong is a sentence on standard error and exit status 2, without a traceback; exit status 1 is
left to what is wrong with the program itself.
"""

import atexit
import os
import signal
import sys
from types import FrameType

from bench.cli import standard_streams

REFUSED = 2
"""Exit status for what a user can put right; 1 is left to what is wrong with the program itself."""
INTERRUPTED = 128 + signal.SIGINT
"""Exit status after Ctrl-C, as shells have it; after another signal it is 128 and its number, too."""


def main() -> None:
    """Run the command line.

    The verbs are imported in here: every child process of a race imports the script of its parent once more, and it
    needs nothing of theirs.
    """
    if sys.platform != "linux":
        print("piezobench: Linux only; on this system the library works from Python: piezo_model", file=sys.stderr)
        sys.exit(REFUSED)
    signal.signal(signal.SIGINT, _end)
    status = 1  # of a traceback

    def leave() -> None:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:  # which it is where its descriptor was closed
                stream.flush()
        os._exit(status)

    atexit.register(leave)  # which comes last: to free all that the libraries have made takes a second
    try:
        standard_streams.prepare()
        from bench.cli.app import run
    except standard_streams.OutputError as error:
        print(f"piezobench: {error}", file=sys.stderr)
        status = REFUSED
    except ModuleNotFoundError as error:
        print(f"piezobench: the command needs the package {error.name}: install piezobench[bench]", file=sys.stderr)
        status = REFUSED
    else:
        status = run(sys.argv[1:])
    sys.exit(status)


def _end(number: int, frame: FrameType | None) -> None:
    """End at once: while libraries are imported nothing has begun, and many take an interrupt for an error of their
    own."""
    os._exit(INTERRUPTED)
