"""A child process that is forked from a server, for libraries that take long to import.

The server has imported what all children need (qpsolvers is among it, and it imports every library that it finds), with
every thread pool limited to one thread.
"""

import multiprocessing
import os
import tempfile
from collections.abc import Iterable
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle, send_handle
from typing import Any

from bench.messages.race_error import RaceError
from piezo_model.child_process import Child, serve
from solvers.registry import FAMILIES, Entry

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
PRELOADED = ("bench.processes.forked_child", "bench.processes.worker", "solvers.core")
"""What the server imports in any case; absent ones are passed over."""


def _context(entries: Iterable[Entry] = (), modules: Iterable[str] = ()) -> Any:
    for name in THREAD_VARIABLES:
        os.environ[name] = "1"
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(
        [*PRELOADED, *modules, *{f"solvers.{entry.lane}_lane" for entry in entries if entry.lane in FAMILIES}]
    )
    return context


def warm_up(entries: Iterable[Entry], modules: Iterable[str] = ()) -> None:
    """Start the server that children are forked from, with these modules and what the lanes of these solvers need
    imported.

    It imports for a second or two, beside whatever comes next; one that runs already stays as it is. RaceError where
    its socket has no place.
    """
    _context(entries, modules)
    try:
        forkserver.ensure_running()
    except OSError as error:
        if "AF_UNIX path too long" not in str(error):
            raise
        raise RaceError(
            f"{tempfile.gettempdir()} has too long a name for the sockets of the solvers' processes; "
            "set TMPDIR to another folder"
        ) from None


class ForkedChild(Child):
    """A child of the server."""

    def _start(self, lent: Connection, alive: Connection) -> None:
        assert self._connection is not None
        self._process = _context().Process(target=_serve, daemon=True, args=(lent, alive))
        self._process.start()
        send_handle(self._connection, self._log.fileno(), self._process.pid)

    def _exit_code(self, within_s: float) -> int | None:
        self._process.join(within_s)
        return self._process.exitcode


def _serve(connection: Connection, alive: Connection) -> None:
    """Serve, with what is printed going to the parent's file."""
    try:
        sink = recv_handle(connection)
    except EOFError:  # the parent has ended meanwhile
        return
    os.dup2(sink, 1)
    os.dup2(sink, 2)
    serve(connection, alive)
