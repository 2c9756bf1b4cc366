"""One core for each race: a name for each core, held by the process that times on it.

Timing tasks of two races, or of two workers of one, never share a core. The name is that of an abstract socket: one
place for all users of a machine, whatever their folders for temporary files and their rights, and free when its process
has ended, however that was.
"""

import errno
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager

LOOK_EVERY_S = 0.5


def usable() -> list[int]:
    """Cores that this process may run on, the last first: interrupts and the system prefer the first.

    Of the main thread, since others may be pinned.
    """
    return sorted(os.sched_getaffinity(os.getpid()), reverse=True)


class Core(socket.socket):
    """A core that nobody else times on until this is closed."""

    number: int

    @contextmanager
    def pinned(self) -> Iterator[None]:
        """Keep the calling thread on it too, off the cores of other workers."""
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {self.number})
        try:
            yield
        finally:
            os.sched_setaffinity(0, before)


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
            core = Core(socket.AF_UNIX)
            try:
                core.bind(f"\0piezobench-core{number}")
            except OSError as error:
                core.close()
                if error.errno != errno.EADDRINUSE:
                    raise
            else:
                core.number = number
                return core
        time.sleep(LOOK_EVERY_S)
