"""The child's side of the closed-loop race: one solver learns for both axes of the stage while the stage follows its
reference.

The child hands back what the stage did, what was to be learned and what was taken over; the parent judges it.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from qpsolvers import Problem

from bench.messages.task import Outcome, Request, Task
from bench.stage.setup import StageSetup
from piezo_model import IdentificationProblem
from piezo_model.stage.learning import SelfLearningStage
from solvers.arrays import Matrix, Vector
from solvers.protocol import Solver
from solvers.registry import add_file

LOOK_EVERY_S = 0.01
"""How often the learners are looked at; far shorter than any phase but the one of learning."""


@dataclass(frozen=True)
class Decision:
    """The end of a learning phase of one axis."""

    sample: int
    """When it came."""
    taken: bool
    """Whether the new weights were taken over."""
    weights: Vector
    """Those that were learned, in use from the next block on, or where they were refused those in use. Shape (d,)."""
    problem: IdentificationProblem | None
    """What was to be solved; None where it did not come to that."""
    learned_until: int
    """Last sample that was learned from; the solver began there."""
    error_old: float
    error_new: float
    message: str


@dataclass
class Driven(Outcome):
    """What came back: the measured platform (N, 2), the decisions of each axis, and faults that its learner saw."""

    platform: Matrix = field(default_factory=lambda: np.zeros((0, 2)))
    decisions: tuple[list[Decision], ...] = ()
    faults: int = 0


@dataclass(frozen=True)
class LoopRequest(Request):
    """Close the loop over the setup's stage, whose learners ask for the solver of the task by name, lane and setting.

    ``file`` is that of a user's own solver, which is made known first.
    """

    task: Task
    setup: StageSetup
    file: Path | None = None

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Warm the solver up on a problem of two variables if need be, then run."""
        if self.file is not None:
            add_file(self.file)
        if first:
            solver = cls(**self.task.settings_for(cls, 1.0))
            solver.setup(Problem(np.eye(2), np.array([-1.0, 1.0]), lb=np.zeros(2), ub=np.full(2, np.inf)))
            solver.solve()
        return drive(self.setup)


def drive(setup: StageSetup) -> Driven:
    """Follow the whole reference."""
    stage = setup.stage()
    loop = SelfLearningStage([setup.learner(structure) for structure in setup.structures], setup.decoupling)
    found = Driven(found=True, decisions=tuple([] for _ in loop.learners))
    look, parts = max(1, round(LOOK_EVERY_S / setup.sample_time)), []
    for done in range(0, len(setup.y_ref), look):
        parts.append(loop.run(setup.y_ref[done : done + look], stage.run)[1])
        for learner, decisions in zip(loop.learners, found.decisions, strict=True):
            while learner.log:
                event = learner.log.popleft()
                if event.what == "sensor":
                    found.faults += 1
                else:
                    decisions.append(
                        Decision(
                            event.sample,
                            event.what == "hand-over",
                            learner.learned_weights,
                            learner.problem,
                            event.learning_since,
                            event.error_old,
                            event.error_new,
                            event.message,
                        )
                    )
    found.platform = np.concatenate(parts)
    return found
