"""What every race does: find out who is there, do each task that is not done yet, keep it, watch the machine, and carry
on after an interruption.

A kind of race is a :class:`Race`: what solvers are asked, and what is made of their answers. Its tasks come in parts. A
part is what one worker does in one go; every finished task is on disk before the next one starts, and the notes of a
part (where it ran, what disturbed it, how the sentinel fared) come last and say that it is done. Parts come in phases:
those of a phase may be done in any order, and the next phase is planned by the rows of those before.
"""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from bench.messages.progress import Progress
from bench.messages.task import Outcome, Request, Row, Task
from bench.processes import engine, sentinel
from bench.processes.engine import Workers
from bench.processes.solver_child import SolverPool
from bench.processes.worker import ChildSettings
from bench.races import null_solver
from bench.races.field import checked, field_of
from bench.races.settings import RaceSettings
from bench.store import Run, Schema
from bench.timing import cores, machine
from piezo_model.atomic_file import replacing
from solvers.registry import Described, Entry

S = TypeVar("S", bound=RaceSettings)
Tell = Callable[[Task], None]
"""Told what comes next."""


@dataclass(frozen=True)
class Part(ABC):
    """Tasks that one worker does in one go; it can be sent anywhere from where the run's folder is reached."""

    run: Path
    name: str
    """That of its notes, a file name."""
    tasks: tuple[Task, ...]
    repeat: int
    """Another one has fresh processes."""

    def do(self, pool: SolverPool, tell: Tell) -> None:
        """Do what is not done yet; where it is timed, watch the machine, and note what was seen when all is done."""
        run = Run(self.run)
        if run.has_notes(self.name):
            return
        pool.begin(self.repeat)
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
                "sentinel": pool.sentinel.taken(),
                **between,
                "preemptions": sum(row["preemptions"] for row in rows),
                "timed_calls": sum(row["samples"] for row in rows),
            },
        )

    @abstractmethod
    def work(self, run: Run, pool: SolverPool, tell: Tell) -> Sequence[Row]:
        """Do the tasks that are not done; returns the rows that count calls and preemptions."""


class Race(ABC, Generic[S]):
    """One kind of race at work on a run."""

    schema: ClassVar[Schema]
    """Its table."""
    preload: ClassVar[tuple[str, ...]]
    """Modules that its requests need in the process of a solver."""
    timed: ClassVar[bool] = True
    """Whether it times on a core of its own, where the machine is watched."""
    floor: ClassVar[bool] = False
    """Whether the solver that does nothing takes part, the floor of all times."""
    spreads: ClassVar[bool] = False
    """Whether it can use several workers."""
    warnings: Sequence[str] = ()
    """What makes its times less certain, as far as it knows itself."""

    def __init__(self, run: Run, settings: S, progress: Progress) -> None:
        self.run, self.settings, self.progress = run, settings, progress
        self.entrants = {
            (entry.name, entry.lane): entry
            for entry in [*([null_solver.ENTRY] if self.floor else ()), *self.entries(settings)]
        }

    @classmethod
    def entries(cls, settings: S) -> Sequence[Entry]:
        """Who takes part by these settings; RaceError, RunError or ProblemSetError unless there is all that is asked
        for."""
        return checked(settings, cls.preload)

    @property
    def child(self) -> ChildSettings:
        """What the process of a solver may take and see."""
        return ChildSettings(self.settings.time_limit_s, self.settings.memory_mb)

    def prepare(self, resources: ExitStack) -> None:
        """Make what is raced on, or load it; what has to be given back in the end goes onto ``resources``."""

    @abstractmethod
    def phases(self, field: Sequence[Described]) -> Iterator[Sequence[Part]]:
        """The parts of each phase for the solvers that run here; those of a phase are done when the next one is asked
        for."""

    def finish(self) -> None:
        """What is left to do when no solver runs any more."""


class TaskRace(Race[S]):
    """A race in which a task is one request and its answer."""

    failed: ClassVar[Mapping[str, Any]] = {}
    """Columns of a row of a failure that are not empty."""

    def part(self, name: str, *tasks: Task) -> Part:
        """A part whose tasks are done one after the other."""
        return _Each(self.run.path, name, tasks, 0, self)

    def measure(self, task: Task, pool: SolverPool) -> Outcome:
        """What becomes of a task."""
        return pool.child(task).ask(self.request(task))

    @abstractmethod
    def request(self, task: Task) -> Request:
        """What the solver of a task is asked."""

    @abstractmethod
    def judged(self, task: Task, outcome: Any) -> Sequence[Mapping[str, Any]]:
        """The columns of each row that follow from an outcome which is not a failure, its status among them."""

    def known(self, task: Task, outcome: Outcome) -> Mapping[str, Any]:
        """Columns of every row of a task, be it one of a failure."""
        return {}

    def rows(self, task: Task, outcome: Outcome) -> list[Row]:
        """The rows of a task, once for each tier that its setting stands for."""
        shared = self.schema.row(
            **{**task.columns(), "status": outcome.failure, "message": outcome.message, **self.known(task, outcome)}
        )
        found = [self.failed] if outcome.failure else self.judged(task, outcome)
        tiers = [{"tier": str(tier), "basis": basis} for tier, basis in task.basis.items()] or [{}]
        return [{**shared, **tier, **figures} for tier in tiers for figures in found]


@dataclass(frozen=True)
class _Each(Part):
    """One task after the other."""

    race: TaskRace[Any]

    def work(self, run: Run, pool: SolverPool, tell: Tell) -> Sequence[Row]:
        for task in self.tasks:
            tell(task)
            if not run.is_done(task):
                outcome = self.race.measure(task, pool)
                run.save(task, self.race.rows(task, outcome), outcome.times)
        return ()


def drive(race: Race[Any], workers: Workers) -> None:
    """Do whatever is not done yet."""
    run, progress, done, total = race.run, race.progress, 0, 0

    def tell(task: Task) -> None:
        nonlocal done
        progress(str(task), done, total)
        done += 1

    entries = tuple(race.entrants.values())
    with ExitStack() as resources:
        race.prepare(resources)
        settings, core = replace(race.child, preload=race.preload), None
        if race.timed and workers.is_one:
            progress("waiting for a core on which no other race times", 0, 1)
            core = resources.enter_context(cores.claim()).number
        pool = resources.enter_context(SolverPool(entries, settings, core))
        field = field_of(run, pool)
        if not workers.is_one:
            pool.close()
        for parts in race.phases(field):
            total += sum(len(part.tasks) for part in parts)
            if workers.is_one:
                for part in parts:
                    part.do(pool, tell)
            else:
                for part in engine.distribute(parts, entries, settings, workers):
                    for task in part.tasks:
                        tell(task)
    race.finish()
    if race.timed:
        note_conditions(race, workers)


def note_conditions(race: Race[Any], workers: Workers) -> None:
    """Keep how the machine fared while it timed, and say what makes the times less certain."""
    run, notes = race.run, race.run.all_notes()
    samples = sentinel.table(notes)
    with replacing(run.path / "sentinel.parquet") as temporary:
        samples.to_parquet(temporary, index=False)
    run.note(
        conditions={
            "sentinel_drift": sentinel.drift(samples),
            "parts": [{name: value for name, value in note.items() if name != "sentinel"} for note in notes],
            "warnings": [*sentinel.sentences(samples), *machine.disturbances(notes, workers.count), *race.warnings],
        }
    )
