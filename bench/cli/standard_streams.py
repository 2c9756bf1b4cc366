"""Standard input, output and error of the command: all three are open, and what cannot be written is one sentence."""

import io
import os
import sys
from contextlib import suppress
from typing import TextIO


class OutputError(Exception):
    """Standard output cannot be written; the message is one sentence. No OSError, of which libraries think that it is
    theirs."""


class _Stream(io.FileIO):
    """A standard stream that goes to the null device from the first failure on, which of standard error is said
    nowhere."""

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
    """Make the streams safe to write to; OutputError where there is no standard output.

    A descriptor that the caller closed would be that of the next file that is opened, and what is printed would go into
    it.
    """
    there = [_is_open(number) for number in range(3)]
    for _ in range(there.count(False)):
        os.open(os.devnull, os.O_RDWR)  # which takes the lowest number that is free
    sys.stderr = _stream(2, sys.stderr, lines=True)
    if not there[1]:
        raise OutputError("standard output is closed; send it to a file, or to /dev/null")
    sys.stdout = _stream(1, sys.stdout, lines=sys.stdout.isatty())


def _stream(number: int, before: TextIO | None, lines: bool) -> TextIO:
    raw = _Stream(number, "w", closefd=False)
    return io.TextIOWrapper(io.BufferedWriter(raw), before.encoding if before else "utf-8", line_buffering=lines)


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True
