"""Whether a solver's answers are right: one solve of each program of a set, judged in exact arithmetic, nothing timed.

An answer's error is the larger of its relative cost gap and its relative violation (`bench.races.metrics`). A solver
has two settings here: its defaults, and the finest rung of its ladder if it has one.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from qpsolvers import Problem

from bench.messages.progress import Progress, silent
from bench.problems.protocol import RaceProblem
from bench.processes.forked_child import ForkedChild
from bench.races.metrics import relative_gap
from piezo_model.child_process import LateError, LostError
from solvers import Entry, Unsupported
from solvers.arrays import Vector

LIMIT_S = 10.0
"""Time limit of one program, after which the solver's process is ended."""
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


def checked_settings(entry: Entry) -> Mapping[str, bool]:
    """Names of the settings to check, and whether each is the finest rung."""
    return {"default": False, "finest": True} if len(entry.load().ladder(1.0)) > 1 else {"default": False}


def checked(entry: Entry, finest: bool, problems: Sequence[RaceProblem], progress: Progress = silent) -> list[Checked]:
    """The answers of a solver to programs in original units, in a process of its own."""
    found = []
    with ForkedChild() as child:
        for done, problem in enumerate(problems):
            progress(f"{entry.name} {problem.name}", done, len(problems))
            form = problem.forms["raw"]
            supported = True
            try:
                supported, claims, x, why = child.call(LIMIT_S, solved, entry, finest, form.unit, form.qp)
            except LateError:
                claims, x, why = False, None, f"no answer within {LIMIT_S:g} s"
            except LostError as loss:
                claims, x, why = False, None, f"the process ended with {loss}"
            if x is not None and x.shape == form.qp.q.shape and np.isfinite(x).all():
                found.append(Checked(problem.name, claims, max(relative_gap(form, x)), "" if claims else why))
            elif claims:
                found.append(Checked(problem.name, claims, math.inf, "called solved, without a finite answer (d,)"))
            else:
                found.append(Checked(problem.name, claims, math.nan, why, supported))
    return found


def solved(entry: Entry, finest: bool, unit: float, qp: Problem) -> tuple[bool, bool, Vector | None, str]:
    """Whether a solver takes a program, whether it claims to have solved it, its answer, and what it said otherwise."""
    cls = entry.load()
    try:
        solver = cls(**(cls.ladder(unit)[-1] if finest else {}))
        solver.setup(qp)
        x = solver.solve()
        solution = solver.solution()
    except Unsupported as error:
        return False, False, None, str(error)
    except Exception as error:  # a library may raise anything, which is its answer
        return True, False, None, f"{type(error).__name__}: {error}"
    return True, bool(solution.found), np.array(x), str(solution.extras.get("status", ""))


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
