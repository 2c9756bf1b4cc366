"""The one-shot race: every problem, in each scaling, by every solver in every lane at each tier.

For each problem and scaling the solvers come one after the other, each hot in its own process on the same core, and then
take turns; see `unit`. Beside them runs a solver that does nothing, the floor of all times.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from typing import TypeVar

from bench.problems import make
from bench.problems.protocol import RaceProblem
from bench.processes import engine
from bench.processes.compiling import compile_solvers
from bench.processes.engine import Workers
from bench.processes.isolation import Child, entry_of_file, warm_up
from bench.races import null_solver
from bench.races.line_up import LineUp
from bench.races.rows import PERIOD_US
from bench.races.settings import RaceError, RaceSettings
from bench.races.task import Task
from bench.races.unit import Unit, do
from bench.store import Run, RunError
from bench.timing import cores, machine, sentinel
from piezo_model.atomic_file import replacing
from piezo_model.identification_problem import Scaling
from solvers import Lane, entries
from solvers.registry import Described, Entry

__all__ = ["PERIOD_US", "Progress", "RaceError", "RaceSettings", "Workers", "carry_on", "checked", "entries_of", "field_of",
           "note_conditions", "problems_of", "settings_of", "start", "started", "tasks_of"]

Progress = Callable[[str, int, int], None]
"""Told what is being done, how much of it is done, and how much there is."""

Settings = TypeVar("Settings", bound=RaceSettings)


def entries_of(settings: RaceSettings) -> list[Entry]:
    """The entries that are asked for, by name and lane; those of the user's own files always are."""
    known = list(entries())
    names = {entry.name for entry in known}
    unknown = sorted(set(settings.solvers) - names)
    if unknown:
        raise RaceError(f"there is no solver {unknown[0]!r}; known are {', '.join(sorted(names))}")
    chosen = [entry for entry in known
              if entry.lane in settings.lanes and (not settings.solvers or entry.name in settings.solvers)]
    taken = {(entry.name, entry.lane) for entry in known}
    for path in settings.solver_files:
        try:
            entry = entry_of_file(path)
        except ImportError as error:
            raise RaceError(str(error)) from None
        if not re.fullmatch(r"\w[\w.+-]*", entry.name):  # it becomes part of file names
            raise RaceError(f"{path}: a solver is named with letters, digits, '_', '.', '+' and '-', and not {entry.name!r}")
        if (entry.name, entry.lane) in taken:
            raise RaceError(f"{path}: there is a solver {entry.name} in the lane {entry.lane} already; name it otherwise")
        taken.add((entry.name, entry.lane))
        chosen.append(entry)
    if not chosen:
        raise RaceError(f"no solver of those asked for is in the lane {' or '.join(settings.lanes)}")
    return chosen


def tasks_of(settings: RaceSettings, field: Sequence[Described], problem: RaceProblem, scaling: Scaling, repeat: int = 0,
             ) -> Iterator[Task]:
    """All tasks of one problem in one scaling; a solver with variants shows those at the first tier only.

    Warm tasks are there for solvers that make use of a start, on problems that have one.
    """
    follows = problem.forms[scaling].warm_start is not None
    for solver in field:
        for tier in settings.tiers if solver.variants == ({},) else settings.tiers[:1]:
            for variant in solver.variants:
                yield Task(problem.set_name, problem.name, scaling, solver.name, solver.lane, tier, variant, repeat)
                if follows and solver.warm_start:
                    yield Task(problem.set_name, problem.name, scaling, solver.name, solver.lane, tier, variant, repeat,
                               "warm")


def units_of(run: Run, settings: RaceSettings, field: Sequence[Described], problems: Sequence[RaceProblem]) -> list[Unit]:
    """All that is to be done, in order; the solver that does nothing opens each unit."""
    floor = null_solver.ENTRY
    return [Unit(run.path.resolve(), problem.set_name, problem.name, scaling, repeat,
                 (Task(problem.set_name, problem.name, scaling, floor.name, floor.lane, settings.interleaved_tier,
                       repeat=repeat), *tasks_of(settings, field, problem, scaling, repeat)))
            for repeat in range(settings.repeats) for problem in problems for scaling in settings.scalings]


@contextmanager
def started(chosen: Sequence[Entry], settings: RaceSettings, core: int | None = None) -> Iterator[list[Child]]:
    """The processes of the field, all starting at once."""
    with ExitStack() as stack:
        yield [stack.enter_context(Child(entry, settings.time_limit_s, settings.memory_mb, core)) for entry in chosen]


def checked(settings: RaceSettings) -> list[Entry]:
    """The entries that are asked for; RaceError or ProblemSetError unless there is all that is asked for."""
    for problem_set in settings.problem_sets:
        make(problem_set, settings.seed, settings.set_options)
    return entries_of(settings)


def start(results: Path, settings: RaceSettings, name: str | None = None, kind: str = "oneshot") -> Run:
    """Make the run's folder."""
    checked(settings)
    return Run.create(results, {"race": kind, "settings": settings.to_dict(), "machine": machine.describe()}, name)


def carry_on(run: Run, progress: Progress, workers: Workers | None = None) -> None:
    """Do whatever is not done yet and gather the tables."""
    workers = workers or Workers()
    settings = settings_of(run, RaceSettings)
    workers.check()
    with run.alone():
        warm_up()
        chosen = checked(settings)
        compile_solvers(chosen, progress)
        problems = list(problems_of(run, settings, progress))
        (_race_here if workers.is_one else _race_spread)(run, settings, chosen, problems, progress, workers)
        progress("gathering the tables", 0, 1)
        note_conditions(run, workers)
        run.finish()


def settings_of(run: Run, kind: type[Settings] = RaceSettings) -> Settings:  # type: ignore[assignment]
    """The settings that a run was started with."""
    try:
        return kind.from_dict(run.settings["settings"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RunError(f"{run.path / 'run.json'}: does not hold the settings of a race ({error!r})") from None


def _race_here(run: Run, settings: RaceSettings, chosen: Sequence[Entry], problems: Sequence[RaceProblem],
               progress: Progress, workers: Workers) -> None:
    """Do the units in this process."""
    progress("waiting for a core on which no other race times", 0, 1)
    with (cores.claim() as core,
          LineUp([null_solver.ENTRY, *chosen], settings, core.number) as line_up):
        floor, *processes = line_up.children.values()
        floor.describe()
        units = units_of(run, settings, field_of(run, processes)[0], problems)
        total, done = sum(len(unit.tasks) for unit in units), 0

        def tell(task: Task) -> None:
            nonlocal done
            progress(f"{task.solver} ({task.lane}) on {task.problem}, {task.scaling}", done, total)
            done += 1

        for unit in units:
            do(unit, line_up, tell)


def _race_spread(run: Run, settings: RaceSettings, chosen: Sequence[Entry], problems: Sequence[RaceProblem],
                 progress: Progress, workers: Workers) -> None:
    """Do the units on several workers; this process only asks which solvers there are."""
    with started(chosen, settings) as processes:
        units = units_of(run, settings, field_of(run, processes)[0], problems)
    progress(f"{len(units)} problems in a scaling", 0, len(units))
    for done, unit in enumerate(engine.spread(units, [null_solver.ENTRY, *chosen], settings, workers)):
        progress(f"{unit.problem}, {unit.scaling}", done + 1, len(units))


def note_conditions(run: Run, workers: Workers) -> None:
    """Keep how the machine fared while it timed, and say what makes the times less certain."""
    notes = run.all_notes()
    looks = sentinel.table(notes)
    with replacing(run.path / "sentinel.parquet") as temporary:
        looks.to_parquet(temporary, index=False)
    run.note(conditions={
        "sentinel_drift": sentinel.drift(looks), "parts": [{name: value for name, value in note.items() if name != "sentinel"}
                                                           for note in notes],
        "warnings": [*sentinel.sentences(looks), *machine.disturbances(notes, workers.count)]})


def field_of(run: Run, processes: Sequence[Child]) -> tuple[list[Described], dict[tuple[str, Lane], Child]]:
    """The solvers that run here, noted in the run, and the processes by name and lane; RaceError where there is none."""
    described = [child.describe() for child in processes]
    field = [solver for solver in described if not solver.absent]
    run.note_field({f"{solver.name} ({solver.lane})": solver.version for solver in field},
                   {f"{solver.name} ({solver.lane})": solver.absent for solver in described if solver.absent})
    if not field:
        raise RaceError(f"none of the solvers asked for runs here; {described[0].name}: {described[0].absent}")
    return field, {(child.entry.name, child.entry.lane): child for child in processes}


def problems_of(run: Run, settings: RaceSettings, progress: Progress) -> Iterator[RaceProblem]:
    """Load the problems of the sets that were made and kept, and make the others; what is raced is what was kept."""
    for set_name in settings.problem_sets:
        kept = run.settings.get("problems", {}).get(set_name, ())
        if not kept or not all(run.problem_path(set_name, name).is_file() for name in kept):
            kept = list(_made(run, settings, set_name, progress))
            run.note(problems={**run.settings.get("problems", {}), set_name: kept})
        for i, name in enumerate(kept):
            progress(f"{set_name}/{name}", i + 1, len(kept))
            yield run.problem(set_name, name)


def _made(run: Run, settings: RaceSettings, set_name: str, progress: Progress) -> Iterator[str]:
    """Make the problems of a set and keep those that are not kept yet; yields their names."""
    made = make(set_name, settings.seed, settings.set_options)
    count = min(len(made), settings.limit or len(made))
    for i, problem in enumerate(islice(made.problems(), count)):
        progress(f"certified {set_name}/{problem.name}", i + 1, count)
        path = run.problem_path(set_name, problem.name)
        if not path.is_file():
            problem.save(path)
        yield problem.name
