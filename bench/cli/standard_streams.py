"""Standard input, output and error of the command: all three are open, and a failed write ends in one sentence."""

import io
import os
import sys
from contextlib import suppress
from typing import TextIO


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


def prepare() -> None:
    """Make the streams safe to write to; OutputError if there is no standard output.

    The next file that is opened would take the number of a descriptor that the caller closed, and printed text would
    end up in it. A character that the terminal's encoding lacks is printed as an escape sequence.
    """
    closed = []
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:  # the lowest free number
        closed.append(number)
    os.close(number)
    sys.stderr = _stream(2, sys.stderr, lines=True)
    if 1 in closed:
        raise OutputError("standard output is closed; send it to a file, or to /dev/null")
    sys.stdout = _stream(1, sys.stdout, lines=sys.stdout.isatty())


def _stream(number: int, before: TextIO | None, lines: bool) -> TextIO:
    raw = _Stream(number, "w", closefd=False)
    encoding = before.encoding if before else "utf-8"
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding, errors="backslashreplace", line_buffering=lines)
