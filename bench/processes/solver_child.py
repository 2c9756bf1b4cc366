"""Each solver in a process of its own, with a time and a memory limit.

A solver that crashes, hangs or eats memory takes its own process with it and nothing else; the next task gets a new
one. The processes of a race on one core form a pool: one for each solver lane, and the sentinel's.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TypeVar

from bench.messages.task import Outcome, Request, Task
from bench.processes import worker
from bench.processes.forked_child import ForkedChild
from bench.processes.sentinel import Sentinel
from bench.processes.worker import ChildSettings
from piezo_model.child_process import START_LIMIT_S, LateError, LostError
from solvers import Lane
from solvers.registry import Described, Entry

E = TypeVar("E", bound=Entry)

STANDARD = ChildSettings()
BUILD_LIMIT_S = 60.0
"""Seconds on top for a task of the lane codegen, since the first of a shape of problem generates and compiles."""


def entry_of_file(path: str | Path, of_file: Callable[[str], E]) -> E:
    """The entry of a user's file, whose code runs in a process of its own; ImportError says what is wrong."""
    with ForkedChild() as child:
        try:
            found = child.call(START_LIMIT_S, worker.introduce, str(path), of_file)
        except LateError:
            found = f"did not load within {START_LIMIT_S:g} s"
        except LostError as error:
            found = f"ended the process that loaded it with {error}"
    if isinstance(found, str):
        raise ImportError(f"{path}: {found}")
    return found


class SolverChild(ForkedChild):
    """The process of one solver in one lane, pinned to a core if one is given; started at once, and again after it was
    lost."""

    def __init__(self, entry: Entry, settings: ChildSettings = STANDARD, core: int | None = None) -> None:
        super().__init__()
        self.entry, self._settings, self._core = entry, settings, core
        self.time_limit_s = settings.time_limit_s + (BUILD_LIMIT_S if entry.lane is Lane.CODEGEN else 0.0)
        self._load()

    def _load(self) -> None:
        self._described: Described | None = None
        self.begin(worker.load, self.entry, self._settings, self._core)

    def describe(self) -> Described:
        """What the solver is, or why it is absent; waits until its library is loaded."""
        if self._described is None:
            try:
                if not self.is_running:
                    self._load()
                self._described = self.wait(START_LIMIT_S)
            except LateError:
                self._described = self._absent(f"its library did not load within {START_LIMIT_S:g} s")
            except LostError as error:
                self._described = self._absent(f"its library could not be loaded: the process ended with {error}")
            if self._described.absent:
                self.close()
        return self._described

    def _absent(self, why: str) -> Described:
        return Described(self.entry.name, self.entry.lane, "", "", "", False, absent=why)

    def ask(self, request: Request) -> Outcome:
        """Answer a request; whatever the solver does to its process is an outcome, too."""
        if not self.is_running:
            self._described = None
        if absent := self.describe().absent:
            return Outcome("adapter_failed", absent)
        if self.has_spoken:
            self.kill()
            return Outcome("tampered", "its process answered before it was asked")
        try:
            outcome = self.call(self.time_limit_s, worker.answer, request)
        except LateError as error:
            return Outcome("timed_out", str(error))
        except LostError as error:
            memory = "bad_alloc" in error.last_words or "MemoryError" in error.last_words
            return Outcome("out_of_memory" if memory else "crashed", f"the process ended with {error}")
        if outcome.failure == "out_of_memory":
            self.kill()  # who knows what it still holds
        return outcome


class SolverPool(ExitStack):
    """Solvers that wait for requests on a core, or where there is room if nothing is timed, all starting at once.

    Attributes
    ----------
    children : dict
        By name and lane.
    sentinel : Sentinel
        Looks at the core.
    """

    def __init__(self, entries: Sequence[Entry], settings: ChildSettings, core: int | None = None) -> None:
        super().__init__()
        self.entries, self.settings, self.core = tuple(entries), settings, core
        self._start(repeat=0)

    def _start(self, repeat: int) -> None:
        self._repeat = repeat
        self.sentinel = self.enter_context(Sentinel(self.core))
        self.children: dict[tuple[str, Lane], SolverChild] = {
            (entry.name, entry.lane): self.enter_context(SolverChild(entry, self.settings, self.core))
            for entry in self.entries
        }

    def begin(self, repeat: int) -> None:
        """Put fresh processes in the place of those that have run another repeat."""
        if repeat != self._repeat:
            self.close()
            self._start(repeat)
            for child in self.children.values():
                child.describe()  # waits until all have loaded, which otherwise would disturb the first task

    def child(self, task: Task) -> SolverChild:
        """The process of a task's solver."""
        return self.children[task.solver, task.lane]
