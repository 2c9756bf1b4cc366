"""The one-shot race: every problem, in each scaling, by every solver in every lane at every setting of its ladder.

For each problem and scaling the solvers come one after the other, each hot in its own process on the same core (`unit`); when all is
measured, a second pass follows at one setting each (`second_pass`). Beside them runs a solver that does nothing, the floor of all times.
"""

from __future__ import annotations

from collections.abc import Sequence

from bench.passed.progress import Progress
from bench.passed.task import NO_SETTING, Task
from bench.problems.protocol import RaceProblem
from bench.processes import engine
from bench.processes.engine import Workers
from bench.processes.line_up import LineUp
from bench.races import null_solver
from bench.races.conditions import note_conditions
from bench.races.field import checked, field_of
from bench.races.oneshot.second_pass import second_pass
from bench.races.oneshot.settings import OneshotSettings
from bench.races.oneshot.tasks import tasks_of
from bench.races.oneshot.unit import Unit
from bench.races.run_problems import keep_proofs, problems_of, watched_folders
from bench.races.settings import settings_of
from bench.store import Run
from bench.timing import cores
from solvers.registry import Described, Entry


def race(run: Run, progress: Progress, workers: Workers) -> None:
    """Do whatever is not done yet."""
    settings = settings_of(run, OneshotSettings)
    chosen = checked(settings)
    problems = list(problems_of(run, settings, progress))
    (_race_here if workers.is_one else _race_spread)(run, settings, chosen, problems, progress, workers)
    keep_proofs(run, problems)
    note_conditions(run, workers)


def units_of(run: Run, settings: OneshotSettings, field: Sequence[Described], problems: Sequence[RaceProblem]) -> list[Unit]:
    """The first pass, in order; the solver that does nothing opens each unit."""
    floor = null_solver.ENTRY
    return [Unit(run.path.resolve(), settings, problem, scaling, repeat,
                 (Task(problem.set_name, problem.name, scaling, floor.name, floor.lane, NO_SETTING, repeat=repeat),
                  *tasks_of(settings, field, problems, i, scaling, repeat)))
            for repeat in range(settings.repeats) for i, problem in enumerate(problems) for scaling in settings.scalings]


def _race_here(run: Run, settings: OneshotSettings, chosen: Sequence[Entry], problems: Sequence[RaceProblem],
               progress: Progress, workers: Workers) -> None:
    """Do the units in this process."""
    progress("waiting for a core on which no other race times", 0, 1)
    with cores.claim() as core, LineUp([null_solver.ENTRY, *chosen], settings.limits, core.number, watched_folders(run)) as line_up:
        floor, *children = line_up.children.values()
        floor.describe()
        field = field_of(run, children)
        units = units_of(run, settings, field, problems)
        total, done = sum(len(unit.tasks) for unit in units), 0

        def tell(task: Task) -> None:
            nonlocal done
            progress(f"{task.solver} ({task.lane}) on {task.problem}, {task.scaling}", done, total)
            done += 1

        for unit in units:
            unit.do(line_up, tell)
        after = second_pass(run, settings, field, units)
        total += sum(len(part.warm) + len(part.longer) for part in after)
        for part in after:
            part.do(line_up, tell)


def _race_spread(run: Run, settings: OneshotSettings, chosen: Sequence[Entry], problems: Sequence[RaceProblem],
                 progress: Progress, workers: Workers) -> None:
    """Do the units on several workers; this process only asks which solvers there are."""
    with LineUp(chosen, settings.limits, None) as line_up:
        field = field_of(run, line_up.children.values())
    units, entries = units_of(run, settings, field, problems), [null_solver.ENTRY, *chosen]
    progress(f"{len(units)} problems in a scaling", 0, 2 * len(units))
    for done, unit in enumerate(engine.spread(units, entries, settings.limits, workers)):
        progress(f"{unit.problem.name}, {unit.scaling}", done + 1, 2 * len(units))
    after = second_pass(run, settings, field, units)
    for done, part in enumerate(engine.spread(after, entries, settings.limits, workers)):
        progress(f"{part.problem.name}, {part.scaling}, in turns", len(units) + done + 1, 2 * len(units))
