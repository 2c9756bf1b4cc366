"""A task, the unit of work of a race: one problem, in one scaling, by one solver in one lane at one rung of its ladder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from solvers.protocol import Lane, Solver, Tier

if TYPE_CHECKING:  # a child needs tasks and no model
    from piezo_model.identification_problem import Scaling

Start = Literal["cold", "warm"]
"""Whether a solve begins from nothing or from the optimum of the problem before."""


UNASKED = -1
"""In the place of a rung: what a solver does without any settings."""


@dataclass(frozen=True)
class Task:
    """What is run, by name only, so that a task can be sent anywhere and found again."""

    problem_set: str
    problem: str
    scaling: Scaling
    solver: str
    lane: Lane
    tiers: tuple[Tier, ...]
    """What it serves."""
    rung: int = UNASKED
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Solver settings on top of the rung's, such as the number of steps."""
    repeat: int = 0
    """Which of several runs of the same, each in a fresh process."""
    start: Start = "cold"

    @property
    def key(self) -> str:
        """A file name that is the same in every run for the same task."""
        text = json.dumps([self.problem_set, self.problem, self.scaling, self.solver, self.lane, self.rung,
                           dict(self.settings), *([self.repeat] if self.repeat else []),
                           *([self.start] if self.start != "cold" else [])], sort_keys=True)
        return f"{self.solver}-{self.lane}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"

    def asked(self, cls: type[Solver], c: float) -> dict[str, Any]:
        """The settings for a problem whose constant is c."""
        return {**({} if self.rung == UNASKED else cls.ladder(c)[self.rung]), **self.settings}
