"""Settings of a one-shot race, and what is measured by them in its first pass.

That is every setting of every solver on every problem in the first scaling, and its defaults in the others. A
wrapper is measured at its defaults and at one setting more, that which asks for a cost gap nearest to 1e-8,
since it shows what calling a library in another way costs; cvxpy on some problems only.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bench.messages.task import Setting, Task, limited, settings_of
from bench.problems.protocol import RaceProblem
from bench.races.chosen_settings import default_setting
from bench.races.settings import RaceSettings, option
from piezo_model.identification_problem import Scaling
from solvers import Lane
from solvers.registry import FAMILIES, Described

EXPONENT = 8.0
"""Of the setting at which wrappers are compared."""
MOST_OF_CVXPY = 5
"""Problems on which cvxpy is measured."""


@dataclass(frozen=True)
class OneshotSettings(RaceSettings):
    """What is raced and how; stored with the run, so that it can be resumed."""

    problem_sets: tuple[str, ...] = ("paper", "measured")
    rounds: int = option(10, "Turns of each solver in shuffled rounds with the others.", least=0)
    """Rounds in which solvers take turns, one update and solve each; 0 leaves them out."""
    iteration_limits: tuple[int, ...] = ()
    """Limits at which solvers that have one are measured beside their settings, ascending."""


@dataclass(frozen=True)
class AnytimeSettings(OneshotSettings):
    """Of a race that asks how exact an answer is after so much time."""

    scalings: tuple[Scaling, ...] = ("scaled",)
    iteration_limits: tuple[int, ...] = (*(step * 10**power for power in range(6) for step in (1, 2, 5)), 10**6)


def tasks_of(
    settings: OneshotSettings,
    field: Sequence[Described],
    problems: Sequence[RaceProblem],
    number: int,
    scaling: Scaling,
    repeat: int = 0,
) -> Iterator[Task]:
    """The tasks of the problem of that number among all in one scaling; those of a solver lane follow each other, from
    loose to tight, then by growing limit of iterations."""
    problem, first = problems[number], scaling == settings.scalings[0]
    for solver in field:
        if solver.lane is Lane.CVXPY and number not in evenly(len(problems), MOST_OF_CVXPY):
            continue
        chosen = measured(solver) if first else [default_setting(solver)]
        asked: list[tuple[Setting, dict[str, int]]] = [(setting, {}) for setting in chosen]
        if solver.iteration_setting and first:
            rungs = {setting.text for setting in settings_of(solver)}
            limits = {limit: limited(solver, limit) for limit in settings.iteration_limits}
            asked += [
                (setting, {solver.iteration_setting: limit})
                for limit, setting in limits.items()
                if setting.text not in rungs
            ]
        for setting, more in asked:
            yield Task(
                problem.set_name,
                problem.name,
                scaling,
                solver.name,
                solver.lane,
                setting,
                more,
                repeat,
                d=problem.d,
            )


def measured(solver: Described) -> Sequence[Setting]:
    """The settings of a solver that are measured."""
    every = settings_of(solver)
    if solver.lane not in FAMILIES or not solver.exponents:
        return every
    nearest = min(range(len(solver.exponents)), key=lambda rung: abs(solver.exponents[rung] - EXPONENT))
    return [setting for setting in every if setting.is_default or setting.rung == nearest]


def evenly(count: int, most: int) -> set[int]:
    """At most so many of ``count`` numbers, evenly spread.

    Examples
    --------
    >>> sorted(evenly(18, 5))
    [0, 3, 7, 10, 14]
    """
    return {i * count // min(count, most) for i in range(min(count, most))} if count else set()
