"""The race: every problem, in each scaling, by every solver in every lane at every setting of its ladder.

    pass             first every setting, then one setting of each lane again
      repeat         with fresh processes
        part         one problem in one scaling, done by one worker, in one file
          block      calls with fresh data that are sent at once; a round of interleaved lanes is a block of each

For each problem and scaling the solvers are timed one after the other, each hot in its own process on the same core
at every setting; a second pass follows at one setting of each (`passes`). The null solver, which does nothing, is
the floor of all times.

Every finished task is saved before the next one starts; the notes of a part (its host, disturbances, the sentinel's
samples) come last and mark it as done. The parts of a pass may be done in any order, and the next pass follows from the
rows of the earlier ones.

In the first scaling every setting of every solver is measured on every problem, in the others only the defaults. A
wrapper shows the cost of another way to call a library, so it is measured at its defaults and at one more setting, the
one for a cost gap nearest to 1e-8.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from operator import methodcaller
from typing import Any

from bench.messages import user_cache
from bench.messages.task import (
    NO_SETTING,
    PAPER,
    ChildSettings,
    Progress,
    Setting,
    Task,
    default_setting,
    settings_ladder,
)
from bench.problems.protocol import RaceProblem
from bench.processes import engine, sentinel
from bench.processes.solver_child import SolverPool
from bench.races import null_solver
from bench.races.lanes import checked, lanes_here
from bench.races.passes import Part, second_pass
from bench.races.run_problems import problems_of, save_certificates
from bench.races.settings import RaceSettings
from bench.store import Run
from bench.timing import cores, machine
from piezo_model.atomic_file import replacing
from piezo_model.identification_problem import Scaling
from piezo_model.json_file import decoded
from solvers.protocol import setting_text
from solvers.registry import FAMILIES, Described

EXPONENT = 8.0
"""Exponent of the cost gap at which wrappers are compared."""
FEWEST_PROVEN, PROVEN = 3, 24
"""Most timed answers of a task that are judged in exact arithmetic: this many, or as many over all problems."""


def run_tasks(run: Run, settings: RaceSettings, progress: Progress, workers: engine.Workers) -> None:
    """Do the tasks that are not done yet; the certificates, which solvers must not see, are saved at the end."""
    entries = (null_solver.ENTRY, *checked(settings))
    hidden = (str(run.path.resolve()), str(user_cache.folder()))
    limits, core = ChildSettings(settings.time_limit_s, settings.memory_mb, hidden), None
    with ExitStack() as resources:
        problems = list(problems_of(run, settings, progress))
        if workers.is_single:
            core = resources.enter_context(cores.claim()).number
        pool = resources.enter_context(SolverPool(entries, limits, core))
        lanes = lanes_here(run, pool)
        if not workers.is_single:
            pool.close()
        map_unordered = resources.enter_context(engine.started(workers))
        work = methodcaller("do", pool) if workers.is_single else partial(engine.work, entries=entries, settings=limits)
        for parts in passes(run, settings, lanes, problems):
            progress("timing the solvers", 0, len(parts))
            for done, part in enumerate(map_unordered(work, parts), 1):
                progress(f"timed {part.problem.name}, {part.scaling}", done, len(parts))
    save_certificates(run, problems)
    note_conditions(run)


def note_conditions(run: Run) -> None:
    """Save the condition of the machine during the race, with warnings about less certain times."""
    notes = [part.notes for part in run.parts() if part.notes is not None]
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


def passes(
    run: Run, settings: RaceSettings, lanes: Sequence[Described], problems: Sequence[RaceProblem]
) -> Iterator[Sequence[Part]]:
    """The first pass and the second over the problems of a run, each divided by problem, scaling and repeat; each part
    begins with the null solver. A pass is requested when the one before is done."""

    def tasks(problem: RaceProblem, scaling: Scaling, repeat: int) -> Iterator[Task]:
        of_problem, nothing = (problem.set_name, problem.name, scaling), null_solver.ENTRY
        yield Task(*of_problem, nothing.name, nothing.lane, NO_SETTING, repeat=repeat, d=problem.d)
        yield from tasks_of(settings, lanes, problem, scaling, repeat)

    first = [
        Part(
            run.path.resolve(),
            f"{problem.set_name}--{problem.name}--{scaling}--{repeat}",
            tuple(tasks(problem, scaling, repeat)),
            repeat,
            settings,
            problem,
            scaling,
            max(FEWEST_PROVEN, math.ceil(PROVEN / len(problems))),
        )
        for repeat in range(settings.repeats)
        for problem in problems
        for scaling in settings.scalings
    ]
    yield first
    yield [*second_pass(run, settings, lanes, first)]


def tasks_of(
    settings: RaceSettings,
    solvers: Sequence[Described],
    problem: RaceProblem,
    scaling: Scaling,
    repeat: int = 0,
) -> Iterator[Task]:
    """The tasks of a problem in one scaling, those of a lane from loose to tight; the paper's method also begins at the
    straight line, as its compensator does."""
    first = scaling == settings.scalings[0]
    task = partial(Task, problem.set_name, problem.name, scaling, repeat=repeat, d=problem.d)
    for solver in solvers:
        named = partial(task, solver.name, solver.lane)
        override = settings.given.get(solver.name, "")
        measured = first_pass_settings(solver, override) if first else [default_setting(solver)]
        yield from map(named, measured)
        if solver.name == PAPER and "line" in problem.forms[scaling].starts:
            yield from (named(setting, start="line") for setting in measured)


def first_pass_settings(solver: Described, override: str = "") -> Sequence[Setting]:
    """The settings of a solver that are measured in the first scaling: the default and ``override``, or the ladder."""
    if override:
        text = setting_text({**solver.defaults, **decoded(override, dict[str, Any])})
        return [default_setting(solver), Setting(text, 0, is_default=False, override=override)]
    every = settings_ladder(solver)
    if solver.lane not in FAMILIES or not solver.exponents:
        return every
    nearest = min(range(len(solver.exponents)), key=lambda rung: abs(solver.exponents[rung] - EXPONENT))
    return [setting for setting in every if setting.is_default or setting.rung == nearest]
