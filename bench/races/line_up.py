"""The processes of a race on one core: one for each solver lane, and the sentinel's."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from types import TracebackType

from bench.processes.isolation import Child
from bench.races.settings import RaceSettings
from bench.timing.sentinel import Sentinel
from solvers.registry import Entry


class LineUp:
    """Solvers that wait for tasks on a core, all starting at once.

    Parameters
    ----------
    entries : sequence of Entry
    settings : RaceSettings
    core : int

    Attributes
    ----------
    children : dict
        By name and lane.
    sentinel : Sentinel
    """

    def __init__(self, entries: Sequence[Entry], settings: RaceSettings, core: int) -> None:
        self.entries, self.settings, self.core = tuple(entries), settings, core
        self.sentinel = Sentinel(core)
        self._repeat = 0
        self._start()

    def _start(self) -> None:
        self._stack = ExitStack()
        self.children = {(entry.name, str(entry.lane)): self._stack.enter_context(
            Child(entry, self.settings.time_limit_s, self.settings.memory_mb, self.core)) for entry in self.entries}

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
        self.sentinel.close()

    def __enter__(self) -> LineUp:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()
