"""The unit of work of the one-shot race: one problem in one scaling by all solvers, in one repeat.

Solvers that take turns must sit in one place, so a unit is never divided between workers. In it every finished task is on
disk before the next one starts; its notes (where it ran, what disturbed it, how the sentinel fared) come last and say
that it is done.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from bench.passed.row import Row
from bench.passed.task import Task
from bench.problems.protocol import RaceProblem
from bench.processes.line_up import LineUp
from bench.processes.sentinel import EVERY_S
from bench.races.conditions import watched
from bench.races.oneshot.rows import rows_of, times_of, times_of_turns, with_turns
from bench.races.oneshot.settings import OneshotSettings
from bench.races.oneshot.turns import LONGEST_US, most_exact, take_turns
from bench.races.oneshot.worker import OneShot
from bench.store import Run
from piezo_model.identification_problem import Scaling
from solvers import Tier

FOR_THE_PICTURE = 5
"""How much less a rung that serves the picture alone is timed."""
Tell = Callable[[Task], None]
"""Told what comes next."""


@dataclass(frozen=True)
class Unit:
    """What is done in one go; it can be sent anywhere from where the run's folder is reached."""

    run: Path
    settings: OneshotSettings
    problem_set: str
    problem: str
    scaling: Scaling
    repeat: int
    tasks: tuple[Task, ...]

    @property
    def name(self) -> str:
        """A file name."""
        return f"{self.problem_set}--{self.problem}--{self.scaling}--{self.repeat}"

    def do(self, line_up: LineUp, tell: Tell) -> None:
        """Do what is not done yet."""
        run = Run(self.run)
        if run.has_notes(self.name):
            return
        line_up.begin(self.repeat)
        problem = run.problem(self.problem_set, self.problem)
        with watched(run, self.name, line_up.sentinel) as notes:
            rows = _hot(self, run, problem, line_up, tell)
            _in_turns(self, run, problem, line_up, rows)
            notes |= _interruptions(rows)


def _hot(unit: Unit, run: Run, problem: RaceProblem, line_up: LineUp, tell: Tell) -> list[Row]:
    """One task after the other; returns the first row of each."""
    form, rows, effort = problem.forms[unit.scaling], [], unit.settings.effort
    for task in unit.tasks:
        tell(task)
        if run.is_done(task):
            rows.append(run.task(task)[0][0])
        else:
            start = form.warm_start if task.start == "warm" else None
            outcome = line_up.children[task.solver, task.lane].ask(OneShot.of(
                task, form.qp, effort if task.tiers != (Tier.RUNG,) else replace(effort, budget_s=effort.budget_s / FOR_THE_PICTURE),
                start, form.unit))
            ours = rows_of(problem, task, outcome)
            rows.append(ours[0])
            run.save(task, ours, times_of(outcome))
            line_up.sentinel.look(unless_within_s=EVERY_S)
    return rows


def _in_turns(unit: Unit, run: Run, problem: RaceProblem, line_up: LineUp, rows: Sequence[Row]) -> None:
    """Rounds of those that are quick, whose figures are added to the tasks on disk."""
    form, settings = problem.forms[unit.scaling], unit.settings
    quick = {task.key for task, row in zip(unit.tasks, rows, strict=True) if row["update_us"] + row["solve_us_p50"] <= LONGEST_US}
    for task, outcome in take_turns([task for task in most_exact(unit.tasks) if task.key in quick], line_up.children, form.qp,
                                    form.warm_start, settings.rounds, f"{settings.seed} {unit.name}", form.unit):
        ours, times = run.task(task)
        run.save(task, [with_turns(row, outcome) for row in ours], {**times, **times_of_turns(outcome)})


def _interruptions(rows: Sequence[Row]) -> dict[str, int]:
    return {"preemptions": sum(row["preemptions"] for row in rows), "timed_calls": sum(row["samples"] for row in rows)}
