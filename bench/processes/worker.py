"""The child process in which a solver runs; the parent's side is in `isolation`.

The child loads one solver in one lane, is pinned to a core, and answers requests. It decides nothing about right and
wrong: it hands back the answer with its duals, the raw times and what it noticed about the solver's manners.
"""

from __future__ import annotations

import os
import resource
import signal
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solvers.protocol import Nanoseconds, Solver, Unsupported
from solvers.registry import Described, Entry, describe, from_file

Vector = NDArray[np.float64]

ORPHAN_S = 3.0
"""Seconds after its time limit at which a solver that hangs ends by itself, since its parent must have been killed."""


@dataclass
class Outcome:
    """What came back from a child.

    Attributes
    ----------
    failure : str
        "", "unsupported", "adapter_failed" or "out_of_memory".
    message : str
        The sentence that goes with a failure.
    found : bool
        What the solver itself says.
    x, y, z, z_box : array
        Answer and duals in qpsolvers' conventions.
    mutated : bool
        Whether the solver wrote into the arrays that it was given.
    repeatable : bool
        Whether the same data gave the same bits again.
    preemptions : int
        How often the process was taken off its core while it was timed.
    """

    failure: str = ""
    message: str = ""
    found: bool = False
    x: Vector | None = None
    y: Vector | None = None
    z: Vector | None = None
    z_box: Vector | None = None
    solver_status: str = ""
    reported_us: float = float("nan")
    iterations: int = -1
    mutated: bool = False
    repeatable: bool = True
    preemptions: int = 0
    setup_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    update_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    solve_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


class Request(ABC):
    """What a parent asks of a child, which answers it with the solver that it has loaded."""

    @abstractmethod
    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Do it; ``first`` says that nothing was compiled, loaded and allocated before."""


def attempt(work: Callable[[], Outcome]) -> Outcome:
    """The outcome of work with a solver, or of what it raises."""
    try:
        return work()
    except Unsupported as error:
        return Outcome("unsupported", str(error))
    except MemoryError as error:
        return Outcome("out_of_memory", f"the memory limit was reached: {error}")
    except Exception as error:  # whatever a library raises is a finding about it, and the race goes on
        return Outcome("adapter_failed", f"{type(error).__name__}: {error}".strip().replace("\n", " ")[:500])


def limit_memory(megabytes: int) -> None:
    """Let this process grow by so much over what it has now; allocations beyond fail."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = pages * resource.getpagesize() + megabytes * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def introduce(connection: Connection, path: str) -> None:
    """Load a user's solver file and hand back its entry, or a sentence that says what is wrong with it."""
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 1)
    os.dup2(sink, 2)
    try:
        connection.send(from_file(path))
    except ImportError as error:
        connection.send(str(error).removeprefix(f"{path} "))
    except Exception as error:  # whatever a user's code does
        connection.send(f"cannot be loaded, {type(error).__name__}: {error}".replace("\n", " "))


def serve(connection: Connection, entry: Entry, core: int | None, memory_mb: int, time_limit_s: float) -> None:
    """Main loop of the child: load the solver and describe it, then answer until the connection closes.

    First comes the descriptor of the parent's file for what solvers print.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent to deal with
    sink = recv_handle(connection)
    os.dup2(sink, 1)
    os.dup2(sink, 2)
    try:
        description = describe(entry)
    except Exception as error:  # whatever a library does while it loads is a reason for its absence
        description = Described(entry.name, entry.lane, "", "", "", False, absent=f"{type(error).__name__}: {error}")
    connection.send(description)
    if description.absent:
        return
    cls = entry.load()
    limit_memory(memory_mb)
    if core is not None:  # after loading, for which all cores are welcome
        os.sched_setaffinity(0, {core})
    first = True
    while True:
        try:
            request = connection.recv()
        except EOFError:
            return
        os.ftruncate(sink, 0)  # what was printed before is nobody's last word
        signal.setitimer(signal.ITIMER_REAL, time_limit_s + ORPHAN_S)
        outcome = request.answer(cls, first)
        first = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        connection.send(outcome)
