"""The unit of work of the one-shot race: one problem in one scaling by all solvers, in one repeat.

Solvers that take turns must sit in one place, so a unit is never divided between workers. In it every finished task is on
disk before the next one starts; its notes (where it ran, what disturbed it, how the sentinel fared) come last and say
that it is done.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.passed.row import Row
from bench.passed.task import Task
from bench.problems.fresh import FreshData
from bench.problems.protocol import RaceProblem
from bench.processes.line_up import LineUp
from bench.processes.sentinel import EVERY_S
from bench.races import null_solver
from bench.races.conditions import watched
from bench.races.oneshot.blocks import timed
from bench.races.oneshot.rows import rows_of, times_of, with_turns
from bench.races.oneshot.settings import OneshotSettings
from bench.races.oneshot.turns import LONGEST_US, most_exact, take_turns
from bench.races.oneshot.worker import Forget
from bench.races.run_problems import watched_folders
from bench.store import Run
from piezo_model.identification_problem import Scaling
from solvers import Tier

NAN = float("nan")
FOR_THE_PICTURE = 5
"""How much less a rung that serves the picture alone is timed."""
Tell = Callable[[Task], None]
"""Told what comes next."""


@dataclass(frozen=True)
class Unit:
    """What is done in one go; it can be sent anywhere from where the run's folder is reached."""

    run: Path
    settings: OneshotSettings
    problem: RaceProblem
    scaling: Scaling
    repeat: int
    tasks: tuple[Task, ...]

    @property
    def name(self) -> str:
        """A file name."""
        return f"{self.problem.set_name}--{self.problem.name}--{self.scaling}--{self.repeat}"

    @property
    def turning(self) -> list[Task]:
        """Tasks that take turns if they are quick."""
        return most_exact(self.tasks) if self.settings.rounds else []

    @property
    def folders(self) -> tuple[str, ...]:
        """What solvers must not look into."""
        return watched_folders(Run(self.run))

    def do(self, line_up: LineUp, tell: Tell) -> None:
        """Do what is not done yet."""
        run = Run(self.run)
        if run.has_notes(self.name):
            return
        line_up.begin(self.repeat)
        fresh = FreshData(self.problem.forms[self.scaling], self.settings.effort.most)
        with watched(run, self.name, line_up.sentinel) as notes:
            rows = _hot(self, run, fresh, line_up, tell)
            _in_turns(self, run, fresh, line_up, rows)
            for child in line_up.children.values():
                if child.is_running:
                    child.ask(Forget())
            notes |= _interruptions(rows)


def _hot(unit: Unit, run: Run, fresh: FreshData, line_up: LineUp, tell: Tell) -> list[Row]:
    """One task after the other; returns the first row of each."""
    rows, effort = [], unit.settings.effort
    kept = unit.turning
    idle = line_up.children[null_solver.ENTRY.name, null_solver.ENTRY.lane]
    for task in unit.tasks:
        tell(task)
        if run.is_done(task):
            rows.append(run.task(task)[0][0])
        else:
            less = replace(effort, budget_s=effort.budget_s / FOR_THE_PICTURE)
            outcome, tally = timed(line_up.children[task.solver, task.lane], idle, task, unit.problem, fresh,
                                   less if task.tiers == (Tier.RUNG,) else effort, keep=task in kept)
            ours = rows_of(unit.problem, task, outcome, max(tally.gaps.values(), default=NAN), tally.fault)
            rows.append(ours[0])
            run.save(task, ours, times_of(outcome))
            line_up.sentinel.look(unless_within_s=EVERY_S)
    return rows


def _in_turns(unit: Unit, run: Run, fresh: FreshData, line_up: LineUp, rows: Sequence[Row]) -> None:
    """Rounds of those that are quick, whose figures are added to the tasks on disk."""
    form, settings = unit.problem.forms[unit.scaling], unit.settings
    quick = {task.key for task, row in zip(unit.tasks, rows, strict=True) if row["update_us"] + row["solve_us_p50"] <= LONGEST_US}
    for task, tally in take_turns([task for task in unit.turning if task.key in quick], line_up.children, form, fresh,
                                  settings.rounds, f"{settings.seed} {unit.name}"):
        ours, times = run.task(task)
        turns = {"interleaved_update": np.concatenate(tally.updates), "interleaved_solve": np.concatenate(tally.solves)}
        run.save(task, [with_turns(row, turns["interleaved_solve"]) for row in ours], {**times, **turns})


def _interruptions(rows: Sequence[Row]) -> dict[str, int]:
    return {"preemptions": sum(row["preemptions"] for row in rows), "timed_calls": sum(row["samples"] for row in rows)}
