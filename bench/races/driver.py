"""The driver of all races: it starts the solvers, runs and saves the tasks that are not done yet, and monitors the
machine.

A kind of race is a :class:`Race`: its requests to solvers, and the rows made of their answers. Its tasks are grouped in
parts, each run by one worker in one go. Every finished task is saved before the next one starts; the notes of a part
(its host, disturbances, the sentinel's samples) come last and mark it as done. Parts are grouped in phases:
the parts of a phase may be done in any order, and the next phase follows from the rows of the earlier ones.
"""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from bench.messages.task import ChildSettings, Outcome, Progress, Request, Row, Task
from bench.processes import engine, sentinel
from bench.processes.solver_child import SolverPool
from bench.races import null_solver
from bench.races.field import checked, described_by, field_of
from bench.races.settings import RaceSettings
from bench.store import Run, Schema
from bench.timing import cores, machine
from piezo_model.atomic_file import replacing
from solvers.registry import Described, Entry

S = TypeVar("S", bound=RaceSettings)
Tell = Callable[[Task], None]
"""Called with each task before it starts."""


@dataclass(frozen=True)
class Part(ABC):
    """Tasks that one worker does in one go, on any host that can access the run's folder."""

    run: Path
    name: str
    """File name of its notes."""
    tasks: tuple[Task, ...]
    repeat: int
    """Number of the repeat; each has fresh processes."""

    def do(self, pool: SolverPool, tell: Tell) -> None:
        """Do the tasks that are not done yet; a part that is timed monitors the machine and saves notes at the end."""
        run = Run(self.run)
        if run.has_notes(self.name):
            return
        pool.begin(self.repeat)
        described_by(run, pool)
        if pool.core is None:
            self.work(run, pool, tell)
            return
        pool.sentinel.sample()
        before = machine.counters()
        rows = self.work(run, pool, tell)
        between = machine.between(before, machine.counters())
        pool.sentinel.sample()
        run.save_notes(
            self.name,
            {
                "host": os.uname().nodename,
                "core": pool.core,
                "sentinel": pool.sentinel.take_samples(),
                **between,
                "preemptions": sum(row["preemptions"] for row in rows),
                "timed_calls": sum(row["samples"] for row in rows),
            },
        )

    @abstractmethod
    def work(self, run: Run, pool: SolverPool, tell: Tell) -> Sequence[Row]:
        """Do the tasks that are not done yet; returns rows with their numbers of calls and preemptions."""


class Race(ABC, Generic[S]):
    """A race of one kind on a run."""

    schema: ClassVar[Schema]
    """The table of its rows."""
    preload: ClassVar[tuple[str, ...]]
    """Modules that its requests need in a solver's process."""
    timed: ClassVar[bool] = True
    """Whether it times on a reserved core and monitors the machine."""
    floor: ClassVar[bool] = False
    """Whether the null solver takes part, the floor of all times."""
    spreads: ClassVar[bool] = False
    """Whether several workers may do its parts."""

    def __init__(self, run: Run, settings: S, progress: Progress) -> None:
        self.run, self.settings, self.progress = run, settings, progress
        self.entrants = {
            (entry.name, entry.lane): entry
            for entry in [*([null_solver.ENTRY] if self.floor else ()), *self.entries(settings)]
        }

    @classmethod
    def entries(cls, settings: S) -> Sequence[Entry]:
        """The solvers selected by the settings; RaceError, RunError or ProblemSetError if the race cannot be run."""
        return checked(settings, cls.preload)

    @property
    def child(self) -> ChildSettings:
        """Limits of a solver's process."""
        return ChildSettings(self.settings.time_limit_s, self.settings.memory_mb, preload=self.preload)

    def prepare(self, resources: ExitStack) -> None:
        """Generate or load the problems; ``resources`` are released at the end."""

    @abstractmethod
    def phases(self, field: Sequence[Described]) -> Iterator[Sequence[Part]]:
        """The parts of each phase for the solvers that run here; a phase is requested when the earlier ones are
        done."""

    def finish(self) -> None:
        """Called when no solver runs any more."""


class TaskRace(Race[S]):
    """A race in which a task is one request."""

    failed: ClassVar[Mapping[str, Any]] = {}
    """Values of columns in the row of a failure."""

    def part(self, name: str, *tasks: Task) -> Part:
        """A part that does its tasks one after the other."""
        return _TaskPart(self.run.path, name, tasks, 0, self)

    def measure(self, task: Task, pool: SolverPool) -> Outcome:
        """The outcome of a task."""
        return pool.child(task).ask(self.request(task))

    @abstractmethod
    def request(self, task: Task) -> Request:
        """The request of a task."""

    @abstractmethod
    def judged(self, task: Task, outcome: Any) -> Sequence[Mapping[str, Any]]:
        """The columns, status included, of each row of an outcome that is not a failure."""

    def known(self, task: Task, outcome: Outcome) -> Mapping[str, Any]:
        """Further columns of every row of a task, also of a failure."""
        return {}

    def rows(self, task: Task, outcome: Outcome) -> list[Row]:
        """The rows of a task, repeated for each tier that its setting was chosen for."""
        shared = self.schema.row(
            **{**task.columns(), "status": outcome.failure, "message": outcome.message, **self.known(task, outcome)}
        )
        judged = [self.failed] if outcome.failure else self.judged(task, outcome)
        tiers = [{"tier": str(tier), "basis": basis} for tier, basis in task.basis.items()] or [{}]
        return [{**shared, **tier, **figures} for tier in tiers for figures in judged]


@dataclass(frozen=True)
class _TaskPart(Part):
    """Tasks that are one request each."""

    race: TaskRace[Any]

    def work(self, run: Run, pool: SolverPool, tell: Tell) -> Sequence[Row]:
        for task in self.tasks:
            tell(task)
            if not run.is_done(task):
                outcome = self.race.measure(task, pool)
                run.save(task, self.race.rows(task, outcome), outcome.times)
        return ()


def drive(race: Race[Any], workers: engine.Workers) -> None:
    """Do the tasks that are not done yet."""
    run, progress, done, total = race.run, race.progress, 0, 0

    def tell(task: Task) -> None:
        nonlocal done
        progress(str(task), done, total)
        done += 1

    entries = tuple(race.entrants.values())
    with ExitStack() as resources:
        race.prepare(resources)
        settings, core = race.child, None
        if race.timed and workers.is_one:
            core = resources.enter_context(cores.claim()).number
        pool = resources.enter_context(SolverPool(entries, settings, core))
        field = field_of(run, pool)
        if not workers.is_one:
            pool.close()
        map_unordered = resources.enter_context(engine.started(workers, engine.close_workers))
        for parts in race.phases(field):
            total += sum(len(part.tasks) for part in parts)
            if workers.is_one:
                for part in parts:
                    part.do(pool, tell)
            else:
                function = partial(engine.work, entries=entries, settings=settings)
                for part in map_unordered(function, parts):
                    for task in part.tasks:
                        tell(task)
    race.finish()
    if race.timed:
        note_conditions(race)


def note_conditions(race: Race[Any]) -> None:
    """Save the condition of the machine during the race, with warnings about less certain times."""
    run, notes = race.run, race.run.all_notes()
    samples = sentinel.table(notes)
    with replacing(run.path / "sentinel.parquet") as temporary:
        samples.to_parquet(temporary, index=False)
    run.note(
        conditions={
            "sentinel_drift": sentinel.drift(samples),
            "parts": [{name: value for name, value in note.items() if name != "sentinel"} for note in notes],
            "warnings": [*sentinel.sentences(samples), *machine.disturbances(notes)],
        }
    )
