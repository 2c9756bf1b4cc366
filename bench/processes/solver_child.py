"""Each solver runs in its own process, with a time limit and a memory limit.

A solver that crashes, hangs or exhausts its memory affects only this process; the next task gets a new one. The
processes of a race on one core form a pool: one for each solver lane.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from bench.messages.task import ChildSettings, Outcome, RaceError, Status
from bench.processes import worker
from bench.processes.child_process import FORBIDDEN, START_LIMIT_S, Child, LateError, LostError, warm_up
from solvers import Described, Entry, Lane

STANDARD = ChildSettings()


def entry_of_file(path: str | Path) -> Entry:
    """The entry of a user's file, whose code runs in a separate process; RaceError if it cannot be loaded."""
    with Child(is_trusted=False) as child:
        try:
            entry = child.call(START_LIMIT_S, worker.introduce, str(path))
        except LostError as error:
            entry = f"ended the process that loaded it with {error}"
    if isinstance(entry, str):
        raise RaceError(f"{path}: {entry.removeprefix(f'{path}: ')}")
    return entry


class SolverChild(Child):
    """The process of one solver in one lane, pinned to a core if one is given; it starts at once, and again after a
    crash."""

    def __init__(self, entry: Entry, settings: ChildSettings = STANDARD, core: int | None = None) -> None:
        super().__init__(is_trusted=False)
        self.entry, self._settings, self._core = entry, settings, core
        self._load()

    def _load(self) -> None:
        self._described: Described | None = None
        self.begin(worker.load, self.entry, self._settings, self._core)

    def describe(self) -> Described:
        """The solver's description, or the reason for its absence; waits until its library is loaded."""
        if self._described is None:
            try:
                self._described = self.wait(START_LIMIT_S)
            except LostError as error:
                self._described = Described(
                    self.entry.name,
                    self.entry.lane,
                    "",
                    "",
                    "",
                    False,
                    absent=f"its library could not be loaded: the process ended with {error}",
                )
            if self._described.absent:
                self.close()
        return self._described

    def ask(self, request: Callable[..., Outcome], *arguments: Any) -> Outcome:
        """The outcome of a request, as of `worker.answer`; a crash or a timeout of the process is an outcome, too."""
        if self._connection is None:
            self._load()
        if absent := self.describe().absent:
            return Outcome(Status.ADAPTER_FAILED, absent)
        try:
            outcome = self.call(self._settings.time_limit_s, worker.answer, request, arguments)
        except LateError as error:
            return Outcome(Status.TIMED_OUT, str(error))
        except LostError as error:
            if self.is_interrupted:
                raise ChildProcessError("the race was interrupted") from None
            if error.status == FORBIDDEN:
                return Outcome(Status.TAMPERED, f"its process {error.last_words}")
            return Outcome(
                Status.OUT_OF_MEMORY
                if "bad_alloc" in error.last_words or "MemoryError" in error.last_words
                else Status.CRASHED,
                f"the process ended with {error}",
            )
        if outcome.failure == Status.OUT_OF_MEMORY:
            self.kill()  # it may still hold the memory
        return outcome


class SolverPool(ExitStack):
    """Solver processes that wait for requests on a core, or on any core if nothing is timed; all start at once.

    Attributes
    ----------
    children : dict
        Processes by name and lane.
    """

    def __init__(self, entries: Sequence[Entry], settings: ChildSettings, core: int | None = None) -> None:
        super().__init__()
        self.entries, self.settings, self.core = tuple(entries), settings, core
        warm_up(entries)
        self._start(repeat=0)

    def _start(self, repeat: int) -> None:
        self._repeat = repeat
        self.children: dict[tuple[str, Lane], SolverChild] = {
            (entry.name, entry.lane): self.enter_context(SolverChild(entry, self.settings, self.core))
            for entry in self.entries
        }

    def begin(self, repeat: int) -> None:
        """Replace the processes of another repeat by fresh ones."""
        if repeat != self._repeat:
            self.close()
            self._start(repeat)
            for child in self.children.values():
                child.describe()  # waits for the libraries to load, which would disturb the first task

    def interrupt(self) -> None:
        """End the solvers' processes from another thread; their requests are ChildProcessErrors."""
        for child in self.children.values():
            child.interrupt()
