"""Each solver in a process of its own, with a time and a memory limit.

A solver that crashes, hangs or eats memory takes its own process with it and nothing else; the next task gets a new
one. Children are forked from a server process that has imported what all of them need (qpsolvers is among it, and it
imports every library that it finds), with every thread pool limited to one thread.
"""

from __future__ import annotations

import fcntl
import multiprocessing
import os
import signal
import tempfile
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.reduction import send_handle
from pathlib import Path
from types import TracebackType
from typing import Any

from qpsolvers import Problem

from bench.problems.protocol import QP_FIELDS
from bench.processes.worker import Outcome, Request, introduce, serve
from bench.races.oneshot_worker import OneShot
from bench.races.task import Task
from bench.timing.clock import Effort
from solvers.protocol import Lane
from solvers.registry import Described, Entry

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS",
                    "VECLIB_MAXIMUM_THREADS", "NUMEXPR_NUM_THREADS")
START_LIMIT_S = 60.0
BUILD_LIMIT_S = 60.0
"""Seconds on top for a task of the lane codegen, since the first of a shape of problem generates and compiles."""
GRACE_S = 1.0
"""Time for a process to end by itself."""
LAST_BYTES = 10_000
"""Of what a solver prints, where its last words are looked for."""


def _context() -> Any:
    for name in THREAD_VARIABLES:
        os.environ[name] = "1"
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["bench.processes.worker", "cvxpy", "solvers.kernels.vector"])  # absent ones are passed over
    return context


def warm_up() -> None:
    """Start the server that children are forked from; it imports for a second or two, beside whatever comes next."""
    _context()
    forkserver.ensure_running()


def entry_of_file(path: str | Path) -> Entry:
    """The entry of a user's solver file, whose code runs in a process of its own; ImportError says what is wrong."""
    context = _context()
    connection, other = context.Pipe()
    process = context.Process(target=introduce, args=(other, path), daemon=True)
    process.start()
    other.close()
    try:
        found = connection.recv() if connection.poll(START_LIMIT_S) else f"did not load within {START_LIMIT_S:g} s"
    except EOFError:
        process.join(GRACE_S)
        found = f"ended the process that loaded it with {_how(process.exitcode)}"
    finally:
        process.kill()
        process.join()
        connection.close()
    if isinstance(found, Entry):
        return found
    raise ImportError(f"{path}: {found}")


def _how(code: int | None) -> str:
    """How a process ended."""
    return signal.Signals(-code).name if code is not None and code < 0 else f"exit status {code}"


class Child:
    """The process of one solver in one lane; started at once, and again after it was lost.

    Parameters
    ----------
    entry : Entry
        The solver and its lane.
    time_limit_s : float
        Longest time for one task, everything included.
    memory_mb : int
        What the process may allocate once its solver is loaded.
    core : int, optional
        Core that it is pinned to.
    """

    def __init__(self, entry: Entry, time_limit_s: float = 20.0, memory_mb: int = 2048, core: int | None = None) -> None:
        self.entry = entry
        self.time_limit_s = time_limit_s + (BUILD_LIMIT_S if entry.lane is Lane.CODEGEN else 0.0)
        self.memory_mb = memory_mb
        self.core = core
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  it has no name, so that nobody has to remove it
        fcntl.fcntl(self._log, fcntl.F_SETFL, os.O_APPEND)
        self._process: Any = None
        self._connection: Connection | None = None
        self._start()

    def _start(self) -> None:
        context = _context()
        self._connection, other = context.Pipe()
        self._process = context.Process(target=serve, daemon=True,
                                        args=(other, self.entry, self.core, self.memory_mb, self.time_limit_s))
        self._process.start()
        send_handle(self._connection, self._log.fileno(), self._process.pid)
        other.close()
        self._described: Described | None = None

    def describe(self) -> Described:
        """What the solver is, or why it is absent; waits until its library is loaded."""
        if self._described is None:
            self._described = self._first_words()
        return self._described

    def _first_words(self) -> Described:
        def absent(why: str) -> Described:
            return Described(self.entry.name, self.entry.lane, "", "", "", False, absent=why)

        if self._connection is None:
            self._start()
        assert self._connection is not None
        try:
            if not self._connection.poll(START_LIMIT_S):
                self._kill()
                return absent(f"its library did not load within {START_LIMIT_S:g} s")
            described = self._connection.recv()
        except (EOFError, OSError):
            return absent(f"its library could not be loaded: {self._autopsy().message}")
        assert isinstance(described, Described)
        return described

    def run(self, task: Task, problem: Problem, effort: Effort, warm_start: Any = None) -> Outcome:
        """Run one task of the one-shot race."""
        return self.ask(OneShot(task, {name: getattr(problem, name) for name in QP_FIELDS}, effort, warm_start))

    def ask(self, request: Request) -> Outcome:
        """Have a request answered; whatever happens to the process becomes an outcome."""
        if self._process is None:
            self._start()
        absent = self.describe().absent
        if absent:
            self.close()
            return Outcome("adapter_failed", absent)
        assert self._connection is not None
        try:
            self._connection.send(request)
            if not self._connection.poll(self.time_limit_s):
                self._kill()
                return Outcome("timed_out", f"no answer within {self.time_limit_s:g} s")
            outcome = self._connection.recv()
        except (EOFError, OSError):
            return self._autopsy()
        assert isinstance(outcome, Outcome)
        if outcome.failure == "out_of_memory":
            self._kill()  # who knows what it still holds
        return outcome

    def _autopsy(self) -> Outcome:
        """Say how the process ended."""
        self._process.join(GRACE_S)
        code = self._process.exitcode
        log = self._log.fileno()
        printed = os.pread(log, LAST_BYTES, max(os.fstat(log).st_size - LAST_BYTES, 0))
        last_words = printed.decode(errors="replace").strip().splitlines()[-1:]
        self.close()
        how = _how(code)
        said = f", after printing {last_words[0][:200]!r}" if last_words else ""
        if code == -signal.SIGALRM:
            return Outcome("timed_out", f"no answer within {self.time_limit_s:g} s")
        if last_words and ("bad_alloc" in last_words[0] or "MemoryError" in last_words[0]):
            return Outcome("out_of_memory", f"the process ended with {how}{said}")
        return Outcome("crashed", f"the process ended with {how}{said}")

    def _kill(self) -> None:
        """End a process that may not listen."""
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

    def __enter__(self) -> Child:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()
        self._log.close()
