"""The child's side of the closed-loop race: a solver learns for both axes of the stage, which follows its reference.

The child returns the measured platform, and the problem and weights of each learning phase; the parent judges them.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from qpsolvers import Problem

from bench.messages.task import Outcome, Request, Task
from bench.stage.setup import StageSetup
from piezo_model import IdentificationProblem
from piezo_model.learning.events import Event
from piezo_model.stage.learning import SelfLearningStage
from solvers import add_file
from solvers.protocol import Matrix, Solver, Vector

POLL_S = 0.01
"""Interval at which the logs of the learners are read; far shorter than any phase except learning."""


@dataclass(frozen=True)
class LearningEnd:
    """The end of a learning phase of one axis."""

    event: Event
    """Hand-over or refusal."""
    weights: Vector
    """The learned weights, in use from the next block on; after a refusal the weights in use. Shape (d,)."""
    problem: IdentificationProblem | None
    """The problem of the solver; None if the phase ended before it."""

    @property
    def is_hand_over(self) -> bool:
        """Whether the new weights are used."""
        return self.event.what == "hand-over"


@dataclass
class Driven(Outcome):
    """The measured platform (N, 2), the ends of the learning phases of each axis, and the number of sensor faults that
    the learners detected."""

    platform: Matrix = field(default_factory=lambda: np.zeros((0, 2)))
    ends: tuple[list[LearningEnd], ...] = ()
    faults: int = 0


@dataclass(frozen=True)
class LoopRequest(Request):
    """Run the setup's stage in closed loop; its learners find the solver by name, lane and setting.

    ``file`` is the file of a user's own solver, which is registered first.
    """

    task: Task
    setup: StageSetup
    file: Path | None = None

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Warm up the solver on a problem of two variables if it is new, then run."""
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
    driven = Driven(found=True, ends=tuple([] for _ in loop.learners))
    step, parts = max(1, round(POLL_S / setup.sample_time)), []
    for start in range(0, len(setup.y_ref), step):
        parts.append(loop.run(setup.y_ref[start : start + step], stage.run)[1])
        for learner, ends in zip(loop.learners, driven.ends, strict=True):
            while learner.log:
                event = learner.log.popleft()
                if event.what == "sensor":
                    driven.faults += 1
                else:
                    ends.append(LearningEnd(event, learner.learned_weights, learner.problem))
    driven.platform = np.concatenate(parts)
    return driven
