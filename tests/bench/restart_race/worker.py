"""The child's side of the restart race: a solver that has followed one actuator is handed the data of another one."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from qpsolvers import Problem

from bench.messages.solver_info import real
from bench.messages.task import Outcome, Request, Task
from bench.timing.clock import time_call
from solvers.arrays import Vector
from solvers.protocol import Nanoseconds, Solver


@dataclass
class Restarted(Outcome):
    """What came back: the answers (n, d) to the programs after the jump."""

    answers: list[Vector] = field(default_factory=list)
    first_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """The first answer of each jump, update included."""

    @property
    def times(self) -> Mapping[str, Nanoseconds]:
        return {"first": self.first_ns}


@dataclass(frozen=True)
class Restart(Request):
    """Solve the program before the jump, then time the one after it, so many times."""

    task: Task
    before: Mapping[str, Any]
    after: Mapping[str, Any]
    c: float
    jumps: int

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        found = Restarted(found=True)
        taken = []
        for _ in range(self.jumps):
            solver = cls(**self.task.asked(cls, self.c))
            solver.setup(Problem(**self.before))
            start = real(solver.solve())

            def jump(solver: Solver = solver, start: Vector = start) -> None:
                solver.update(P=self.after["P"], q=self.after["q"])
                found.answers.append(np.array(solver.solve(start) if cls.warm_startable else solver.solve()))

            taken.append(time_call(jump))
        found.first_ns = np.array(taken)
        return found
