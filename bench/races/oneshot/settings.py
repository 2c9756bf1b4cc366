"""Settings of a one-shot race, and the tasks of its first pass.

In the first scaling every setting of every solver is measured on every problem, in the others only the defaults. A
wrapper shows the cost of another way to call a library, so it is measured at its defaults and at one more setting, the
one for a cost gap nearest to 1e-8.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from bench.messages.task import PAPER, Setting, Start, Task, limited, settings_ladder
from bench.problems.protocol import RaceProblem
from bench.races.chosen_settings import default_setting
from bench.races.settings import RaceSettings, option
from piezo_model.identification_problem import Scaling
from piezo_model.json_file import decoded
from solvers.protocol import setting_text
from solvers.registry import FAMILIES, Described

EXPONENT = 8.0
"""Exponent of the cost gap at which wrappers are compared."""
COLD: Start = "cold"
LINE: Start = "line"


@dataclass(frozen=True)
class OneshotSettings(RaceSettings):
    """Settings of a one-shot race."""

    problem_sets: tuple[str, ...] = ("paper", "measured")
    rounds: int = option(10, "Rounds in which the solvers are interleaved.", least=0)
    """Rounds of interleaved solves, one update and solve of each solver a round; 0 for none."""
    keep_misses: int = option(5, "Solver lanes whose worst miss of 1e-9 is kept as a file.", least=0)
    """Most solver lanes of which a missed answer is saved with its program."""
    given: dict[str, str] = field(default_factory=dict)
    """Settings of the user's for solvers by name, as JSON, which are measured in place of the ladder."""
    iteration_limits: tuple[int, ...] = ()
    """Ascending iteration limits at which solvers that have one are measured in addition."""


@dataclass(frozen=True)
class AnytimeSettings(OneshotSettings):
    """Settings of a race that measures the accuracy within a time."""

    scalings: tuple[Scaling, ...] = ("scaled",)
    iteration_limits: tuple[int, ...] = (*(step * 10**power for power in range(6) for step in (1, 2, 5)), 10**6)


def tasks_of(
    settings: OneshotSettings,
    solvers: Sequence[Described],
    problem: RaceProblem,
    scaling: Scaling,
    repeat: int = 0,
    session: int = 0,
) -> Iterator[Task]:
    """The tasks of a problem in one scaling; those of a solver lane follow each other, from loose to tight,
    then by iteration limit; the paper's method also begins at the straight line, as its compensator does."""
    first = scaling == settings.scalings[0]
    for solver in solvers:
        measured = (
            first_pass_settings(solver, settings.given.get(solver.name, "")) if first else [default_setting(solver)]
        )
        planned: list[tuple[Setting, dict[str, int]]] = [(setting, {}) for setting in measured]
        if solver.iteration_setting and first:
            rungs = {setting.text for setting in settings_ladder(solver)}
            limits = {limit: limited(solver, limit) for limit in settings.iteration_limits}
            planned += [
                (setting, {solver.iteration_setting: limit})
                for limit, setting in limits.items()
                if setting.text not in rungs
            ]
        tasks = [(setting, more, COLD) for setting, more in planned]
        if solver.name == PAPER and LINE in problem.forms[scaling].starts:
            tasks += [(setting, {}, LINE) for setting in measured]
        for setting, more, start in tasks:
            yield Task(
                problem.set_name,
                problem.name,
                scaling,
                solver.name,
                solver.lane,
                setting,
                more,
                repeat,
                start,
                session=session,
                d=problem.d,
            )


def first_pass_settings(solver: Described, given: str = "") -> Sequence[Setting]:
    """The settings of a solver that are measured in the first scaling: the default and ``given``, or the ladder."""
    if given:
        text = setting_text({**solver.defaults, **decoded(given, dict[str, Any])})
        return [default_setting(solver), Setting(text, 0, is_default=False, given=given)]
    every = settings_ladder(solver)
    if solver.lane not in FAMILIES or not solver.exponents:
        return every
    nearest = min(range(len(solver.exponents)), key=lambda rung: abs(solver.exponents[rung] - EXPONENT))
    return [setting for setting in every if setting.is_default or setting.rung == nearest]
