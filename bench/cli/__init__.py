"""The ``piezobench`` command; each file holds a group of verbs.

A user's mistake ends in one sentence on standard error and exit status 2, without a traceback. Exit status 1 means a
fault of the program itself, or of a user's own solver in a race.
"""

import atexit
import io
import os
import signal
import sys
from contextlib import suppress
from typing import TextIO

REFUSED = 2
"""Exit status after a user's mistake."""
FAILED = 3
"""Exit status of a comparison that found what its options name."""
UNDECIDED = 4
"""Exit status of a comparison whose times tell nothing, and of a proof that takes more work than is allowed."""
INTERRUPTED = 128 + signal.SIGINT
"""Exit status after Ctrl-C, as in shells: 128 plus the number of the signal."""


class OutputError(Exception):
    """Standard output cannot be written; the message is one sentence.

    It is not an OSError, which libraries would handle as their own.
    """


class _Stream(io.FileIO):
    """A standard stream that is redirected to the null device after its first failure; a failure of standard error is
    silent."""

    def write(self, data: object) -> int:
        try:
            return super().write(data)  # type: ignore[arg-type]
        except OSError as error:
            with suppress(OSError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            if self.fileno() == 1:
                raise OutputError(f"standard output cannot be written ({error.strerror})") from None
            return len(memoryview(data))  # type: ignore[arg-type]


def prepare_streams() -> None:
    """Open the standard streams that are closed, and make them safe to write to; OutputError if there is no standard
    output.

    The next file that is opened would take the number of a descriptor that the caller closed, and printed text would
    end up in it. A character that the terminal's encoding lacks is printed as an escape sequence.
    """
    closed = []
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:  # the lowest free number
        closed.append(number)
    os.close(number)
    sys.stderr = _stream(2, sys.stderr, lines=True)
    sys.stdout = _stream(1, sys.stdout, lines=os.isatty(1))
    if 1 in closed:
        raise OutputError("standard output is closed; send it to a file, or to /dev/null")


def _stream(number: int, before: TextIO | None, lines: bool) -> TextIO:
    raw = _Stream(number, "w", closefd=False)
    encoding = before.encoding if before else "utf-8"
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding, errors="backslashreplace", line_buffering=lines)


def main() -> None:
    """Run the command line.

    The verbs are imported inside this function, because every child process of a race imports its parent's script again
    and does not need them.
    """
    if sys.platform != "linux":
        print("piezobench: Linux only; on this system the library works from Python: piezo_model", file=sys.stderr)
        sys.exit(REFUSED)
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        # during the imports nothing is to be tidied up, and many libraries take an interrupt for an error of their own
        signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    status = 1  # after a traceback

    def leave() -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)

    atexit.register(leave)  # runs last, and skips the second that the libraries' own clean-up takes
    try:
        prepare_streams()
        from bench.cli.app import run
    except (OutputError, ModuleNotFoundError) as error:
        absent = f"the command needs the package {getattr(error, 'name', '')}: install piezobench[bench]"
        print(f"piezobench: {absent if isinstance(error, ImportError) else error}", file=sys.stderr)
        status = REFUSED
    else:
        status = run(sys.argv[1:])
    sys.exit(status)
