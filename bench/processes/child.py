"""A process that calls functions for us: it starts, is limited in time, talks, and ends.

Children are forked from a server process that has imported what all of them need (qpsolvers is among it, and it imports
every library that it finds), with every thread pool limited to one thread. What a child prints goes to a file without a
name, where its last words are looked for when it has died.
"""

from __future__ import annotations

import fcntl
import multiprocessing
import os
import signal
import tempfile
from collections.abc import Callable
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle, send_handle
from types import TracebackType
from typing import Any, Self, TypeVar

T = TypeVar("T")

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS",
                    "VECLIB_MAXIMUM_THREADS", "NUMEXPR_NUM_THREADS")
PRELOADED = ["bench.processes.child", "bench.processes.worker", "cvxpy", "solvers.core"]
"""What the server imports; absent ones are passed over."""
START_LIMIT_S = 60.0
"""Time for a process to start and to import what it needs."""
GRACE_S = 1.0
"""Time for a process to end by itself."""
ORPHAN_S = 3.0
"""Seconds after its time limit at which a child that hangs ends by itself, since its parent must have been killed."""
LAST_BYTES = 10_000
"""Of what a child prints, where its last words are looked for."""


class LateError(Exception):
    """The child did not answer in time and was ended."""


class LostError(Exception):
    """The child ended before it answered; the message says how, and ``last_words`` is the last line that it printed."""

    def __init__(self, message: str, last_words: str = "") -> None:
        super().__init__(message)
        self.last_words = last_words


def _context() -> Any:
    for name in THREAD_VARIABLES:
        os.environ[name] = "1"
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    return context


def warm_up() -> None:
    """Start the server that children are forked from; it imports for a second or two, beside whatever comes next."""
    _context()
    forkserver.ensure_running()


class Child:
    """A process of its own; it starts when it is first asked, and again after it was lost.

    Functions and what they take and give travel by pickle, so a function is one of a module. One that raises ends the child.
    """

    def __init__(self) -> None:
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  it has no name, so that nobody has to remove it
        fcntl.fcntl(self._log, fcntl.F_SETFL, os.O_APPEND)
        self._process: Any = None
        self._connection: Connection | None = None

    @property
    def is_running(self) -> bool:
        """Whether there is a process."""
        return self._connection is not None

    def call(self, limit_s: float, function: Callable[..., T], *arguments: Any) -> T:
        """Call a function within the time limit; LateError or LostError where it does not return."""
        self.begin(limit_s, function, *arguments)
        found: T = self.wait(limit_s)
        return found

    def begin(self, limit_s: float, function: Callable[..., Any], *arguments: Any) -> None:
        """Begin a call whose answer is waited for later; past the limit a child without a parent ends by itself."""
        connection = self._connection or self._start()
        try:
            connection.send((limit_s, function, arguments))
        except OSError:
            raise self._lost(limit_s) from None

    def wait(self, limit_s: float) -> Any:
        """What the call returns; LateError or LostError where it does not within the time limit."""
        assert self._connection is not None
        try:
            if self._connection.poll(limit_s):
                return self._connection.recv()
        except (EOFError, OSError):
            raise self._lost(limit_s) from None
        self.kill()
        raise LateError(f"no answer within {limit_s:g} s")

    def _start(self) -> Connection:
        context = _context()
        connection, other = context.Pipe()
        self._process = context.Process(target=_serve, daemon=True, args=(other,))
        self._process.start()
        send_handle(connection, self._log.fileno(), self._process.pid)
        other.close()
        self._connection = connection
        return connection

    def _lost(self, limit_s: float) -> LateError | LostError:
        """How the process ended."""
        self._process.join(GRACE_S)
        code, log = self._process.exitcode, self._log.fileno()
        self.close()
        if code == -signal.SIGALRM:
            return LateError(f"no answer within {limit_s:g} s")
        printed = os.pread(log, LAST_BYTES, max(os.fstat(log).st_size - LAST_BYTES, 0))
        last_words = "".join(printed.decode(errors="replace").strip().splitlines()[-1:])[:200]
        how = signal.Signals(-code).name if code is not None and code < 0 else f"exit status {code}"
        return LostError(how + (f", after printing {last_words!r}" if last_words else ""), last_words)

    def kill(self) -> None:
        """End a process that may not listen."""
        if self._process is not None:
            self._process.kill()
        self.close()

    def close(self) -> None:
        """End the process, if there is one."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        if self._process is not None:
            self._process.join(GRACE_S)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()
            self._process = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()
        self._log.close()


def _serve(connection: Connection) -> None:
    """Main loop of the child: call what is asked for until the connection closes.

    First comes the descriptor of the parent's file for what is printed.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent to deal with
    sink = recv_handle(connection)
    os.dup2(sink, 1)
    os.dup2(sink, 2)
    while True:
        try:
            limit_s, function, arguments = connection.recv()
        except EOFError:
            return
        os.ftruncate(sink, 0)  # what was printed before is nobody's last word
        signal.setitimer(signal.ITIMER_REAL, limit_s + ORPHAN_S)
        found = function(*arguments)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        connection.send(found)
