"""The race: every problem, in each scaling, by every solver in every lane at every setting of its ladder.

    pass             first every setting, then one setting of each lane again
      repeat         with fresh processes
        part         one problem in one scaling, done by one worker, in one file
          block      calls with fresh data that are sent at once; a round of interleaved lanes is a block of each

For each problem and scaling the solvers are timed one after the other, each hot in its own process on the same core
at every setting; a second pass follows at one setting of each (`passes`). The null solver, which does nothing, is
the floor of all times.

In the first scaling every setting of every solver is measured on every problem, in the others only the defaults. A
wrapper shows the cost of another way to call a library, so it is measured at its defaults and at one more setting, the
one for a cost gap nearest to 1e-8.
"""

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from bench.messages.task import NO_SETTING, PAPER, Setting, Task, default_setting, settings_ladder
from bench.problems.protocol import RaceProblem
from bench.races import null_solver
from bench.races.passes import Part, second_pass
from bench.races.settings import RaceSettings
from bench.store import Run
from piezo_model.identification_problem import Scaling
from piezo_model.json_file import decoded
from solvers.protocol import setting_text
from solvers.registry import FAMILIES, Described

EXPONENT = 8.0
"""Exponent of the cost gap at which wrappers are compared."""
FEWEST_PROVEN, PROVEN = 3, 24
"""Most timed answers of a task that are judged in exact arithmetic: this many, or as many over all problems."""


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
