"""The one-shot race: every problem, in each scaling, by every solver in every lane at the rungs of its ladder
that each tier asks for.

For each problem and scaling the solvers come one after the other, each hot in its own process on the same core, and then
take turns; see `unit`. Beside them runs a solver that does nothing, the floor of all times.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from bench.passed.progress import Progress
from bench.passed.task import Task
from bench.problems.protocol import RaceProblem
from bench.processes import engine
from bench.processes.engine import Workers
from bench.processes.line_up import LineUp
from bench.races import null_solver
from bench.races.calibration import Found, Who, measurements, rungs_of
from bench.races.conditions import note_conditions
from bench.races.field import checked, field_of
from bench.races.oneshot.settings import OneshotSettings
from bench.races.oneshot.unit import Unit
from bench.races.run_problems import keep_proofs, problems_of, watched_folders
from bench.races.settings import settings_of
from bench.store import Run
from bench.timing import cores
from piezo_model.identification_problem import Scaling
from solvers import Tier
from solvers.registry import Described, Entry

PICTURED, MOST_PICTURED = 4, 5
"""One problem in so many is in the picture of time against accuracy with all rungs, and no more than so many problems."""


def race(run: Run, progress: Progress, workers: Workers) -> None:
    """Do whatever is not done yet."""
    settings = settings_of(run, OneshotSettings)
    chosen = checked(settings)
    problems = list(problems_of(run, settings, progress))
    (_race_here if workers.is_one else _race_spread)(run, settings, chosen, problems, progress, workers)
    keep_proofs(run, problems)
    note_conditions(run, workers)


def tasks_of(settings: OneshotSettings, field: Sequence[Described], found: Mapping[Who, Mapping[Tier, Found]], problem: RaceProblem,
             scaling: Scaling, repeat: int = 0, pictured: bool = True) -> Iterator[Task]:
    """All tasks of one problem in one scaling, each rung once with the tiers that it serves.

    Warm tasks are there for solvers that make use of a start, on problems that have one; none is for the picture, which shows
    some problems in the first scaling.
    """
    follows = problem.forms[scaling].warm_start is not None
    left_out = {*(() if problem.has_noise else (Tier.STAGE,)), *(() if pictured and scaling == settings.scalings[0] else (Tier.RUNG,))}
    for solver in field:
        for rung, tiers in measurements(settings, solver, found[solver.name, solver.lane], scaling):
            if tiers := tuple(tier for tier in tiers if tier not in left_out):
                task = Task(problem.set_name, problem.name, scaling, solver.name, solver.lane, tiers, rung, repeat=repeat)
                yield task
                if follows and solver.warm_start and tiers != (Tier.RUNG,):
                    yield replace(task, start="warm")


def units_of(run: Run, settings: OneshotSettings, line_up: LineUp, field: Sequence[Described], problems: Sequence[RaceProblem],
             progress: Progress) -> list[Unit]:
    """All that is to be done, in order; the solver that does nothing opens each unit."""
    floor, apart = null_solver.ENTRY, max(PICTURED, math.ceil(len(problems) / MOST_PICTURED))
    found = {(name, scaling): rungs_of(run, settings, field, line_up.children, name, scaling, progress)
             for name in settings.problem_sets for scaling in settings.scalings}
    return [Unit(run.path.resolve(), settings, problem, scaling, repeat,
                 (Task(problem.set_name, problem.name, scaling, floor.name, floor.lane, (Tier.DEFAULT,), repeat=repeat),
                  *tasks_of(settings, field, found[problem.set_name, scaling], problem, scaling, repeat, i % apart == 0)))
            for repeat in range(settings.repeats) for i, problem in enumerate(problems) for scaling in settings.scalings]


def _race_here(run: Run, settings: OneshotSettings, chosen: Sequence[Entry], problems: Sequence[RaceProblem],
               progress: Progress, workers: Workers) -> None:
    """Do the units in this process."""
    progress("waiting for a core on which no other race times", 0, 1)
    with cores.claim() as core, LineUp([null_solver.ENTRY, *chosen], settings.limits, core.number, watched_folders(run)) as line_up:
        floor, *children = line_up.children.values()
        floor.describe()
        units = units_of(run, settings, line_up, field_of(run, children), problems, progress)
        total, done = sum(len(unit.tasks) for unit in units), 0

        def tell(task: Task) -> None:
            nonlocal done
            progress(f"{task.solver} ({task.lane}) on {task.problem}, {task.scaling}", done, total)
            done += 1

        for unit in units:
            unit.do(line_up, tell)


def _race_spread(run: Run, settings: OneshotSettings, chosen: Sequence[Entry], problems: Sequence[RaceProblem],
                 progress: Progress, workers: Workers) -> None:
    """Do the units on several workers; this process only asks which solvers there are."""
    with LineUp(chosen, settings.limits, None) as line_up:
        units = units_of(run, settings, line_up, field_of(run, line_up.children.values()), problems, progress)
    progress(f"{len(units)} problems in a scaling", 0, len(units))
    for done, unit in enumerate(engine.spread(units, [null_solver.ENTRY, *chosen], settings.limits, workers)):
        progress(f"{unit.problem.name}, {unit.scaling}", done + 1, len(units))
