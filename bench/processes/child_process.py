"""Runs functions in a subprocess with a time limit.

A child is forked from a server that has imported the modules that all children need, since libraries take long to
import, with every thread pool limited to one thread; one of the modules is qpsolvers, which imports every library that
it finds. Nothing is imported from the working folder, where a file ``queue.py`` or a folder ``solvers`` would come
first.

The output of a child goes to an unnamed file, whose last line is reported if it dies. It does not outlive its parent:
when the other end of a pipe between them is closed, the kernel sends it SIGIO, which ends it in any state. It leads a
process group of its own, so the same signal ends the processes that it has started.
"""

import fcntl
import multiprocessing
import os
import pickle
import resource
import signal
import socket
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from multiprocessing import forkserver
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import Any, Self, TypeVar

from bench.messages import wire
from bench.messages.task import RaceError
from solvers.registry import FAMILIES, Entry

T = TypeVar("T")

START_LIMIT_S = 60.0
"""Time limit for a process to start and to import its modules."""
GRACE_S = 1.0
"""Time for a process to end by itself."""
HEADER = struct.Struct("!i")
"""What a connection sends before a message: the number of its bytes."""
MOST_BYTES = 2**28
"""Largest message of a child."""
FORBIDDEN = 77
"""Exit status of a child that did what it must not."""
NOT_REQUESTED = "sent an answer that was not requested"
LAST_BYTES = 10_000
"""Length of the end of a child's output that is searched for its last line."""


THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
PRELOADED = (
    "bench.processes.child_process",
    "bench.processes.worker",
    "bench.problems.foreign",
    "bench.races.worker",
    "solvers.core",
)
"""Modules that the server always imports; it ignores missing ones."""


_starting = threading.Lock()


class LostError(Exception):
    """The child ended before it answered; the message says how, and ``last_words`` is its last line of output.
    ``status`` is FORBIDDEN if the child did what it must not."""

    def __init__(self, message: str, last_words: str = "", status: int | None = None) -> None:
        super().__init__(message)
        self.last_words, self.status = last_words, status


class LateError(LostError):
    """The child did not answer in time and was ended."""


class Child:
    """A subprocess; it starts with the first call, and again after it was lost.

    Functions and arguments are pickled, so a function must belong to a module. An exception ends the child. Results are
    pickled, too, unless the child runs code of others and is not trusted (see `bench.messages.wire`).
    """

    def __init__(self, is_trusted: bool = True) -> None:
        self._is_trusted = is_trusted
        self._connection: Connection | None = None
        self._lifeline: Connection | None = None
        self._log: Any = None
        self._process: Any = None
        self.is_interrupted = False

    def cpu_ns(self) -> int:
        """CPU time of all threads of the process so far, in nanoseconds; 0 if it has ended."""
        try:
            # Linux's CPU clock of another process, see clock_getcpuclockid
            return time.clock_gettime_ns((~self._process.pid << 3) | 2)
        except (OSError, AttributeError):
            return 0

    def call(self, limit_s: float, function: Callable[..., T], *arguments: Any) -> T:
        """Call a function; LateError or LostError if it does not return within the time limit."""
        self.begin(function, *arguments)
        return self.wait(limit_s)

    def begin(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Begin a call; ``wait`` returns its result."""
        if self._connection is None:
            warm_up()
            self._connection, lent = Pipe()
            with socket.socket(fileno=os.dup(self._connection.fileno())) as end:  # where a child reads no request
                end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", int(START_LIMIT_S), 0))
            alive, self._lifeline = Pipe(duplex=False)
            self._log = tempfile.TemporaryFile()  # noqa: SIM115  it has no name and need not be removed
            fcntl.fcntl(self._log, fcntl.F_SETFL, os.O_APPEND)
            with lent, alive, Connection(os.dup(self._log.fileno())) as output:
                self._process = multiprocessing.get_context("forkserver").Process(
                    target=serve, daemon=True, args=(lent, alive, output, self._is_trusted)
                )
                self._process.start()
        self._function = function
        if self._connection.poll(0):  # it has ended, or answers before a request
            raise self._lost()
        try:
            self._connection.send((function, arguments))
        except OSError:
            raise self._lost() from None

    def wait(self, limit_s: float) -> Any:
        """The result of the call; LateError or LostError if it does not return within the time limit."""
        assert self._connection is not None
        end, message, size = time.monotonic() + limit_s, bytearray(), HEADER.size
        while (had := len(message)) < size:  # a message may stop halfway, or come byte by byte
            if not self._connection.poll(max(end - time.monotonic(), 0.0)):
                self.kill()
                raise LateError(f"no answer within {limit_s:g} s")
            with suppress(ConnectionResetError):
                message += os.read(self._connection.fileno(), size - had)
            if len(message) == had:
                raise self._lost()
            if len(message) == HEADER.size:
                size += min(max(HEADER.unpack(message)[0], 0), MOST_BYTES)
        read = pickle.loads if self._is_trusted else partial(wire.read, self._function)
        try:
            return read(message[HEADER.size :])
        except Exception:  # whatever bytes that are no message raise
            raise self._lost() from None

    def _exit_code(self, within_s: float) -> int | None:
        """Exit code of the process; None if it has not ended within that time."""
        self._process.join(within_s)
        return self._process.exitcode

    def _lost(self) -> LostError:
        """Close, and describe how the process ended. If it has not, it broke the protocol."""
        code, log = self._exit_code(GRACE_S), self._log.fileno()
        printed = os.pread(log, LAST_BYTES, max(os.fstat(log).st_size - LAST_BYTES, 0))
        self.close()
        last_words = "".join(printed.decode(errors="replace").strip().splitlines()[-1:])[:200]
        if code is None:
            return LostError(NOT_REQUESTED, NOT_REQUESTED, FORBIDDEN)
        how = {number: number.name for number in signal.Signals}.get(-code, f"exit status {code}")  # type: ignore[call-overload]
        return LostError(how + (f", after printing {last_words!r}" if last_words else ""), last_words, code)

    def kill(self) -> None:
        """End a process that may not respond."""
        if self._connection is not None:
            self._process.kill()
        self.close()

    def interrupt(self) -> None:
        """End the process from another thread than the waiting one, which gets a LostError."""
        self.is_interrupted, process = True, self._process
        if process is not None and process.pid is not None:
            process.kill()

    def close(self) -> None:
        """End the process, if there is one."""
        if self._connection is not None and self._lifeline is not None:
            self._connection.close()  # ends an idle process
            self._connection = None
            if self._exit_code(GRACE_S) is None:
                self._process.kill()
                self._exit_code(START_LIMIT_S)
            with suppress(ProcessLookupError):  # the usual case: its group is empty
                os.killpg(self._process.pid, signal.SIGKILL)
            self._lifeline.close()
            self._log.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def serve(connection: Connection, alive: Connection, output: Connection, is_trusted: bool) -> None:
    """Main loop of the child: run the requested calls until the connection closes, and write to ``output``, which is
    the parent's file."""
    for stream in (1, 2):
        os.dup2(output.fileno(), stream)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    signal.signal(signal.SIGIO, signal.SIG_DFL)
    os.setpgrp()
    pid = os.getpid()
    fcntl.fcntl(alive, fcntl.F_SETOWN, -pid)  # the whole group
    fcntl.fcntl(alive, fcntl.F_SETFL, os.O_ASYNC)
    while True:
        try:
            function, arguments = connection.recv()
        except EOFError:  # also if the parent ended before SIGIO was set up
            return
        os.ftruncate(1, 0)  # forget the output of earlier calls
        result = function(*arguments)
        if os.getpid() != pid:  # the function has forked, and only one of the two may answer
            os._exit(0)
        connection.send_bytes(pickle.dumps(result) if is_trusted else wire.written(result))


def limit_memory(megabytes: int) -> None:
    """Limit the growth of this process from its present size; allocations beyond fail."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = pages * resource.getpagesize() + megabytes * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def warm_up(entries: Iterable[Entry] = ()) -> None:
    """Start the server, which imports what the lanes of these solvers need, too.

    It imports for a second or two in the background; a server that is already running is left unchanged. RaceError if
    the path of its socket is too long.
    """
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    lanes = {f"solvers.{entry.lane}_lane" for entry in entries if entry.lane in FAMILIES}
    forkserver.set_forkserver_preload([*PRELOADED, *lanes])
    # the server, and nothing else that this program starts, imports from where this program does
    own = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with _starting:
        before = {name: os.environ.pop(name) for name in own if name in os.environ}
        os.environ.update(own)
        try:
            forkserver.ensure_running()
        except OSError as error:
            if "AF_UNIX path too long" not in str(error):
                raise
            raise RaceError(
                f"{tempfile.gettempdir()} has too long a name for the sockets of the solvers' processes; "
                "set TMPDIR to another folder"
            ) from None
        finally:
            for name in own:
                del os.environ[name]
            os.environ.update(before)
