"""Whether a solver's answers are right: one solve of each program of a set, judged in exact arithmetic, nothing timed.

An answer's error is the larger of its relative cost gap and its relative violation (`bench.races.metrics`). A solver
has two settings here: its defaults, and the finest rung of its ladder if it has one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.messages.progress import Progress, silent
from bench.messages.task import ChildSettings, Setting, Status, Task, default_setting, settings_ladder
from bench.problem_files.program import fields_of
from bench.problems.protocol import RaceProblem
from bench.processes.solver_child import SolverChild
from bench.races.metrics import relative_gap
from bench.races.oneshot.worker import OneShot
from solvers import Entry

LIMITS = ChildSettings(time_limit_s=10.0, preload=(OneShot.__module__,))
"""Of one program, after which the solver's process is ended."""
LEVELS = (1e-9, 1e-6, 1e-3)
"""Errors by which answers are counted."""


@dataclass(frozen=True)
class Checked:
    """The answer to one program."""

    problem: str
    claims: bool
    """Whether the solver said that it was solved."""
    error: float
    """NaN without an answer."""
    why: str = ""
    """What the solver said, if it has no answer."""
    is_supported: bool = True
    """Whether the solver takes such a program at all."""

    def is_within(self, level: float) -> bool:
        """Whether it is said to be solved, and is as near."""
        return self.claims and self.error <= level

    def is_missed(self, level: float) -> bool:
        """Whether the solver takes the program, and has no such answer."""
        return self.is_supported and not self.is_within(level)

    def verdict(self) -> str:
        """What is wrong with it, in a few words."""
        if not self.claims:
            return f"not solved: {self.why}" if self.why else "not solved"
        return self.why or f"called solved, error {self.error:.1e}"


def checked(entry: Entry, problems: Sequence[RaceProblem], progress: Progress = silent) -> dict[str, list[Checked]]:
    """The answers of a solver to programs in original units, in a process of its own, by the name of its setting."""
    found = {}
    with SolverChild(entry, LIMITS) as child:
        ladder = settings_ladder(child.describe())
        finest = {"finest": ladder[-1]} if len(ladder) > 1 else {}
        for name, setting in {"default": default_setting(child.describe()), **finest}.items():
            found[name] = list[Checked]()
            for done, problem in enumerate(problems):
                progress(f"{entry.name} {problem.name}", done, len(problems))
                found[name].append(_answer(child, setting, problem))
    return found


def _answer(child: SolverChild, setting: Setting, problem: RaceProblem) -> Checked:
    """The answer to one program, as far as it can be measured."""
    form, entry = problem.forms["raw"], child.entry
    task = Task(problem.set_name, problem.name, "raw", entry.name, entry.lane, setting)
    outcome = child.ask(OneShot(task, fields_of(form.qp), c=form.unit))
    x, why = outcome.x, "" if outcome.found else outcome.message or outcome.solver_status
    if x is not None and x.shape == form.qp.q.shape and np.isfinite(x).all():
        return Checked(problem.name, outcome.found, max(relative_gap(form, x)), why)
    if outcome.found:
        return Checked(problem.name, True, math.inf, "called solved, without a finite answer (d,)")
    return Checked(problem.name, False, math.nan, why, outcome.failure != Status.UNSUPPORTED)


def worst(found: Sequence[Checked], count: int) -> list[Checked]:
    """The answers with the largest errors among those that are called solved, then the others."""
    return sorted(found, key=lambda each: (not each.claims, -each.error))[:count]


def row(found: Sequence[Checked]) -> dict[str, Any]:
    """Counts: within each level, wrong and called solved, and not solved by its own word."""
    counts: dict[str, Any] = {f"within {level:.0e}": sum(each.is_within(level) for each in found) for level in LEVELS}
    claimed = [each for each in found if each.claims]
    return counts | {
        "worse, called solved": sum(not each.is_within(LEVELS[-1]) for each in claimed),
        "not solved, and said so": sum(each.is_supported and not each.claims for each in found),
        "unsupported": sum(not each.is_supported for each in found),
        "worst called solved": max((each.error for each in claimed), default=math.nan),
    }
