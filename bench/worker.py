"""The child process in which a solver runs; the parent's side is in `isolation`.

The child loads one solver in one lane, is pinned to a core, and answers requests. It decides nothing about right and
wrong: it hands back the answer with its duals, the raw times and what it noticed about the solver's manners.
"""

from __future__ import annotations

import os
import resource
import signal
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from qpsolvers import Problem

from bench.clock import Effort, time_call, time_kernel, time_pairs
from bench.task import Task
from solvers.protocol import Lane, Nanoseconds, Solver, Unsupported
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
    setup_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    update_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    solve_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


class Request(ABC):
    """What a parent asks of a child, which answers it with the solver that it has loaded."""

    @abstractmethod
    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Do it; ``first`` says that nothing was compiled, loaded and allocated before."""


@dataclass(frozen=True)
class OneShot(Request):
    """Solve one problem and time it."""

    task: Task
    fields: Mapping[str, Any]
    effort: Effort

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Run the task, at first once more to warm up; the same failures come again then."""
        if first:
            run_task(cls, self.task, Problem(**self.fields), Effort(0.0, 1, 1))
        return run_task(cls, self.task, Problem(**self.fields), self.effort)


def _fields(problem: Problem) -> tuple[Any, ...]:
    return problem.P, problem.q, problem.G, problem.h, problem.A, problem.b, problem.lb, problem.ub


def _copy(problem: Problem) -> Problem:
    return Problem(*(None if value is None else value.copy() for value in _fields(problem)))


def _arrays(problem: Problem) -> list[Any]:
    return [part for value in _fields(problem) if value is not None
            for part in ([value] if isinstance(value, np.ndarray) else [value.data, value.indices, value.indptr])]


def run_task(cls: type[Solver], task: Task, problem: Problem, effort: Effort) -> Outcome:
    """Solve one problem, then time setup, update and solve."""
    handed, updated = _copy(problem), _copy(problem)  # a solver that writes into one spoils neither the other nor ours
    outcome = attempt(lambda: _solve_and_time(cls, task, problem, handed, updated, effort))
    outcome.mutated = any(not np.array_equal(a, b, equal_nan=True)
                          for taken in (handed, updated) for a, b in zip(_arrays(problem), _arrays(taken), strict=True))
    return outcome


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


def _solve_and_time(cls: type[Solver], task: Task, problem: Problem, handed: Problem, updated: Problem, effort: Effort,
                    ) -> Outcome:
    solver = cls(task.tier, **task.settings)
    setups = [time_call(lambda: solver.setup(handed))]
    first = np.array(solver.solve(), dtype=np.float64)
    solution = solver.solution()
    extras = solution.extras or {}
    y, z, z_box = (_plain(dual) for dual in (solution.y, solution.z, solution.z_box))
    update = partial(solver.update, P=updated.P, q=updated.q)
    if task.lane is Lane.KERNEL:
        updates, solves = time_kernel(solver, update, effort)
    else:
        updates, solves = time_pairs(update, solver.solve, effort)
    again = np.array(solver.solve(), dtype=np.float64)
    for _ in range(2):
        if sum(setups) < effort.budget_s * 1e9:
            another, fresh = cls(task.tier, **task.settings), _copy(problem)
            setups.append(time_call(partial(another.setup, fresh)))
    reported = extras.get("reported_us")
    return Outcome(found=bool(solution.found), x=first, y=y, z=z, z_box=z_box,
                   solver_status=str(extras.get("status", "")),
                   reported_us=float("nan") if reported is None else float(reported),
                   iterations=int(extras.get("iterations") or -1),
                   repeatable=bool(np.array_equal(first, again, equal_nan=True)),
                   setup_ns=np.array(setups, dtype=np.int64), update_ns=updates, solve_ns=solves)


def _plain(dual: Any) -> Vector | None:
    """Duals as an array of our own, so that nothing of the library's travels to the parent."""
    return None if dual is None else np.array(dual, dtype=np.float64)


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


def serve(connection: Connection, entry: Entry, core: int | None, memory_mb: int, time_limit_s: float, log: str) -> None:
    """Main loop of the child: load the solver and describe it, then answer until the connection closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent to deal with
    sink = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o644)
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
