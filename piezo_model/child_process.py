"""Runs functions in a subprocess with a time limit.

A child is a fresh interpreter, which imports nothing of its parent's program, so that any script may have one. What it
prints goes to a file without a name, where its last words are looked for when it has died. It does not outlive its
parent: the kernel sends it SIGIO, which ends it whatever it is doing, as soon as nobody holds the other end of a pipe
between them. It leads a process group of its own, so that the same signal ends the processes that it has started, too.
"""

import fcntl
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

T = TypeVar("T")

START_LIMIT_S = 60.0
"""Time for a process to start and to import what it needs."""
GRACE_S = 1.0
"""Time for a process to end by itself."""
LAST_BYTES = 10_000
"""Of what a child prints, where its last words are looked for."""


class LateError(Exception):
    """The child did not answer in time and was ended."""


class LostError(Exception):
    """The child ended before it answered; the message says how, and ``last_words`` is the last line that it printed."""

    def __init__(self, message: str, last_words: str = "") -> None:
        super().__init__(message)
        self.last_words = last_words


class Child:
    """A process of its own; it starts when it is first asked, and again after it was lost.

    Functions and what they take and give travel by pickle, so a function is one of a module. One that raises ends the
    child.
    """

    def __init__(self) -> None:
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  it has no name, so that nobody has to remove it
        fcntl.fcntl(self._log, fcntl.F_SETFL, os.O_APPEND)
        self._connection: Connection | None = None
        self._lifeline: Connection | None = None
        self._process: Any = None

    @property
    def is_running(self) -> bool:
        """Whether there is a process."""
        return self._connection is not None

    @property
    def has_spoken(self) -> bool:
        """Whether there is an answer that nobody has waited for yet."""
        return self._connection is not None and self._connection.poll(0)

    def cpu_ns(self) -> int:
        """Nanoseconds of the processor that the process took so far, all its threads, by the system; 0 where it has
        ended."""
        try:
            # Linux's clock of another process, see clock_getcpuclockid
            return time.clock_gettime_ns((~self._process.pid << 3) | 2)
        except (OSError, AttributeError):
            return 0

    def call(self, limit_s: float, function: Callable[..., T], *arguments: Any) -> T:
        """Call a function within the time limit; LateError or LostError where it does not return."""
        self.begin(function, *arguments)
        return self.wait(limit_s)

    def begin(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Begin a call whose answer is waited for later."""
        if self._connection is None:
            self._connection, lent = Pipe()
            alive, self._lifeline = Pipe(duplex=False)
            with lent, alive:
                self._start(lent, alive)
        try:
            self._connection.send((function, arguments))
        except OSError:
            raise self._lost() from None

    def wait(self, limit_s: float) -> Any:
        """What the call returns; LateError or LostError where it does not within the time limit."""
        assert self._connection is not None
        try:
            if self._connection.poll(limit_s):
                return self._connection.recv()
        except (EOFError, OSError):
            raise self._lost() from None
        self.kill()
        raise LateError(f"no answer within {limit_s:g} s")

    def _start(self, lent: Connection, alive: Connection) -> None:
        """Start the process, which gets its end of the connection and of the pipe."""
        program = (
            f"import sys; sys.path[:] = {sys.path!r}; from multiprocessing.connection import Connection; "
            f"from {__name__} import serve; serve(Connection({lent.fileno()}), Connection({alive.fileno()}))"
        )
        self._process = subprocess.Popen(
            [sys.executable, "-c", program],
            pass_fds=[lent.fileno(), alive.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=self._log,
        )

    def _exit_code(self, within_s: float) -> int | None:
        """How the process ended, None where it has not within that time."""
        try:
            return self._process.wait(within_s)
        except subprocess.TimeoutExpired:
            return None

    def _lost(self) -> LostError:
        """How the process ended."""
        code, log = self._exit_code(GRACE_S), self._log.fileno()
        self.close()
        printed = os.pread(log, LAST_BYTES, max(os.fstat(log).st_size - LAST_BYTES, 0))
        last_words = "".join(printed.decode(errors="replace").strip().splitlines()[-1:])[:200]
        how = signal.Signals(-code).name if code is not None and code < 0 else f"exit status {code}"
        return LostError(how + (f", after printing {last_words!r}" if last_words else ""), last_words)

    def kill(self) -> None:
        """End a process that may not listen."""
        if self._connection is not None:
            self._process.kill()
        self.close()

    def interrupt(self) -> None:
        """End the process from another thread than the one that waits for it, which finds it lost and closes."""
        process = self._process
        if process is not None and process.pid is not None:
            process.kill()

    def close(self) -> None:
        """End the process, if there is one."""
        if self._connection is not None and self._lifeline is not None:
            self._connection.close()  # by which it ends
            self._connection = None
            if self._exit_code(GRACE_S) is None:
                self._process.kill()
                self._exit_code(START_LIMIT_S)
            with suppress(ProcessLookupError):  # the usual case: nobody is left of its group
                os.killpg(self._process.pid, signal.SIGKILL)
            self._lifeline.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        self._log.close()


def serve(connection: Connection, alive: Connection) -> None:
    """Main loop of the child: call what is asked for until the connection closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent to deal with
    signal.signal(signal.SIGIO, signal.SIG_DFL)
    os.setpgrp()
    itself = os.getpid()
    fcntl.fcntl(alive, fcntl.F_SETOWN, -itself)  # the whole group
    fcntl.fcntl(alive, fcntl.F_SETFL, os.O_ASYNC)
    while True:
        try:
            function, arguments = connection.recv()
        except EOFError:  # here, too, if the parent had ended before the kernel was asked
            return
        os.ftruncate(1, 0)  # what was printed before is nobody's last word
        found = function(*arguments)
        if os.getpid() != itself:  # the function has forked, and only one of the two may answer
            os._exit(0)
        connection.send(found)


def limit_memory(megabytes: int) -> None:
    """Let this process grow by so much over what it has now; allocations beyond fail."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = pages * resource.getpagesize() + megabytes * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
