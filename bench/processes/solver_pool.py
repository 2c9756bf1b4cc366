"""The processes of a race on one core: one for each solver lane, and the sentinel's."""

from collections.abc import Sequence
from contextlib import ExitStack

from bench.messages.task import Task
from bench.processes.sentinel import Sentinel
from bench.processes.solver_child import SolverChild
from bench.processes.worker import ChildSettings
from solvers import Lane
from solvers.registry import Entry


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
