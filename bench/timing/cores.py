"""One core for each race: a lock file a core, held by the process that times on it.

Timing tasks of two races, or of two workers of one, never share a core. The lock goes with the process that holds it,
however that ends. Lock files lie in the system's folder for temporary files, so that all races of a machine see them.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

LOOK_EVERY_S = 0.5


def usable() -> list[int]:
    """Cores that this process may run on, the last first: interrupts and the system prefer the first.

    Of the main thread, since others may be pinned.
    """
    return sorted(os.sched_getaffinity(os.getpid()), reverse=True)


class Core:
    """A core that nobody else times on."""

    def __init__(self, number: int, lock: int) -> None:
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
        os.close(self._lock)

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
            lock = _opened(Path(tempfile.gettempdir()) / f"piezobench-core{number}.lock")
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(lock)
            else:
                return Core(number, lock)
        time.sleep(LOOK_EVERY_S)


def _opened(path: Path) -> int:
    """A descriptor for locking; the file may belong to another user, which then must not be opened as if to create it."""
    try:
        return os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return os.open(path, os.O_RDONLY | os.O_CREAT, 0o644)
