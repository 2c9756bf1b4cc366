"""The processes of a race on one core: one for each solver lane, and the sentinel's."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType

from bench.processes.sentinel import Sentinel
from bench.processes.solver_child import SolverChild
from solvers import Lane
from solvers.registry import Entry


@dataclass(frozen=True)
class Limits:
    """What a solver may take: seconds for each task, everything included, and megabytes."""

    time_limit_s: float
    memory_mb: int


class LineUp:
    """Solvers that wait for tasks on a core, all starting at once; ``children`` are by name and lane.

    Without a core nothing is timed, and then there is no sentinel. ``folders`` are what solvers must not look into.
    """

    def __init__(self, entries: Sequence[Entry], limits: Limits, core: int | None, folders: Sequence[str] = ()) -> None:
        self.folders = folders
        self.entries, self.limits, self.core = tuple(entries), limits, core
        self._sentinel = None if core is None else Sentinel(core)
        self._repeat = 0
        self._start()

    @property
    def sentinel(self) -> Sentinel:
        """Looks at the core."""
        assert self._sentinel is not None, "nothing is timed here"
        return self._sentinel

    def _start(self) -> None:
        self._stack = ExitStack()
        self.children: dict[tuple[str, Lane], SolverChild] = {
            (entry.name, entry.lane): self._stack.enter_context(
                SolverChild(entry, self.limits.time_limit_s, self.limits.memory_mb, self.core, self.folders)) for entry in self.entries}

    def begin(self, repeat: int) -> None:
        """Put fresh processes in the place of those that have run another repeat."""
        if repeat != self._repeat:
            self._stack.close()
            self._repeat = repeat
            self._start()
            for child in self.children.values():
                child.describe()  # waits until all have loaded, which otherwise would disturb the first task

    def close(self) -> None:
        """End all processes."""
        self._stack.close()
        if self._sentinel is not None:
            self._sentinel.close()

    def __enter__(self) -> LineUp:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()
