"""Locks of the cores, so that two races, or two workers of a race, never time on the same core.

The lock of a core is the name of an abstract socket: all users of a machine share it, whatever their rights and their
folders for temporary files, and it is released when its process ends for any reason.
"""

import errno
import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

POLL_S = 0.5
NAME = "\0piezobench-core{}"


def usable() -> list[int]:
    """Cores that the main thread may run on, since others may be pinned; the last one first, since interrupts and the
    system prefer the first."""
    return sorted(os.sched_getaffinity(os.getpid()), reverse=True)


class Core(socket.socket):
    """The lock of a core, held until it is closed."""

    number: int

    @contextmanager
    def pinned(self) -> Iterator[None]:
        """Pin the calling thread to this core too, off the cores of other workers."""
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {self.number})
        try:
            yield
        finally:
            os.sched_setaffinity(0, before)


def claim(only: int | None = None) -> Core:
    """Lock a core, by default any free one, the last one first; while none is free, wait, and say so.

    Examples
    --------
    >>> with claim() as core:
    ...     core.number in usable()
    True
    """
    announced = False
    while True:
        for number in usable() if only is None else [only]:
            core = Core(socket.AF_UNIX)
            try:
                core.bind(NAME.format(number))
            except OSError as error:
                core.close()
                if error.errno != errno.EADDRINUSE:
                    raise
            else:
                core.number = number
                return core
        if not announced:
            print("waiting for a core: other measurements occupy all of them", file=sys.stderr, flush=True)
            announced = True
        time.sleep(POLL_S)
