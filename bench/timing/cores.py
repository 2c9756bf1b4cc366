"""One core for each race: a name for each core, held by the process that times on it.

Timing tasks of two races, or of two workers of one, never share a core. The name is that of an abstract socket: one place for all
users of a machine, whatever their folders for temporary files and their rights, and free when its process has ended, however
that was.
"""

from __future__ import annotations

import errno
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

LOOK_EVERY_S = 0.5


def usable() -> list[int]:
    """Cores that this process may run on, the last first: interrupts and the system prefer the first.

    Of the main thread, since others may be pinned.
    """
    return sorted(os.sched_getaffinity(os.getpid()), reverse=True)


class Core:
    """A core that nobody else times on."""

    def __init__(self, number: int, lock: socket.socket) -> None:
        self.number, self._lock = number, lock

    @contextmanager
    def pinned(self) -> Iterator[None]:
        """Keep the calling thread on it too, off the cores of other workers."""
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {self.number})
        try:
            yield
        finally:
            os.sched_setaffinity(0, before)

    def release(self) -> None:
        """Give it back."""
        self._lock.close()

    def __enter__(self) -> Core:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.release()


def claim() -> Core:
    """Take a free core, the last one first, or wait until another race is done with one.

    Examples
    --------
    >>> with claim() as core:
    ...     core.number in usable()
    True
    """
    while True:
        for number in usable():
            lock = socket.socket(socket.AF_UNIX)
            try:
                lock.bind(f"\0piezobench-core{number}")
            except OSError as error:
                lock.close()
                if error.errno != errno.EADDRINUSE:
                    raise
            else:
                return Core(number, lock)
        time.sleep(LOOK_EVERY_S)
