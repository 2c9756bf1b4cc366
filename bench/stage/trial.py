"""Runs of the setup: along a straight line, along the best straight line in hindsight, and with self-learning
compensation.

All use the same decoupling matrix and start from the same rest.
"""

from dataclasses import dataclass

import numpy as np

from bench.stage.setup import AXES, StageSetup, percent
from piezo_model import Compensator
from piezo_model.stage.learning import SelfLearningStage
from piezo_model.stage.stage import Stage
from solvers.arrays import Matrix, Vector

HINDSIGHT_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Trial:
    """The record of a run."""

    setup: StageSetup
    x: Matrix
    y: Matrix
    """Drives in V and measured platform in µm along ``setup.y_ref``. Shape (N, 2)."""
    loop: Matrix
    """Measured platform along ``setup.loop_ref`` directly afterwards, without learning. Shape (M, 2)."""

    @property
    def error_um(self) -> Matrix:
        """Tracking error, (N, 2)."""
        return self.y - self.setup.y_ref

    def cycle_error_um(self, cycle: int) -> Matrix:
        """Tracking error in one cycle; −1 is the last."""
        return self.error_um.reshape(-1, self.setup.cycle, len(AXES))[cycle]

    def rms_percent(self, cycle: int = -1) -> Vector:
        """RMS error of each axis in one cycle, percent of the reference's range."""
        return np.asarray(np.sqrt(np.mean(percent(self.cycle_error_um(cycle)) ** 2, axis=0)))

    @property
    def rms_by_cycle(self) -> Vector:
        """RMS error of every cycle in percent of range, both axes taken together, shape (cycles,)."""
        return np.array([np.sqrt(np.mean(self.rms_percent(c) ** 2)) for c in range(self.setup.cycles)])


def straight(setup: StageSetup, slope: Vector | None = None, offset_V: Vector | None = None) -> Trial:
    """Drive along straight lines with the given slopes (V/µm) and offsets (2,); by default those of the ranges."""
    stage = setup.stage()
    if slope is None or offset_V is None:
        slope, offset_V = lines(setup)
    low, high = np.array([axis.x_range for axis in stage.axes]).T
    x = np.clip(slope * (setup.y_ref @ setup.decoupling.T) + offset_V, low, high)
    y = stage.run(x)
    return Trial(setup, x, y, stage.run(np.clip(slope * (setup.loop_ref @ setup.decoupling.T) + offset_V, low, high)))


def lines(setup: StageSetup) -> tuple[Vector, Vector]:
    """Slopes and offsets (2,) of the straight lines through the corners of the ranges."""
    slope = np.array([s.x_scale / s.y_scale for s in setup.structures])
    return slope, np.array([s.x_centre for s in setup.structures]) - slope * np.array(
        [s.y_centre for s in setup.structures]
    )


def best_straight(setup: StageSetup) -> Trial:
    """Drive along the straight lines with the least mean square error over the last cycle, found in hindsight.

    Gauss-Newton on slope and offset of the drive; to first order q follows them as (q_r, 1) times the inverse slope.
    """
    slope, offset_V = lines(setup)
    wanted = (setup.y_ref @ setup.decoupling.T)[-setup.cycle :]
    for _ in range(HINDSIGHT_ROUNDS):
        reached = (straight(setup, slope, offset_V).y @ setup.decoupling.T)[-setup.cycle :]
        for i in range(len(AXES)):
            turn, shift = np.polyfit(wanted[:, i], wanted[:, i] - reached[:, i], 1)
            offset_V[i] += slope[i] * shift
            slope[i] *= 1.0 + turn
    return straight(setup, slope, offset_V)


def learned(setup: StageSetup, cycles: int | None = None) -> Trial:
    """Follow the reference while learning, then the triangles with the last model.

    With ``cycles`` learning stops after that many, and the model is kept, as in a compensator that is made before
    start-up.
    """
    stage = setup.stage()
    loop = SelfLearningStage([setup.learner(structure) for structure in setup.structures], setup.decoupling)
    until = len(setup.y_ref) if cycles is None else cycles * setup.cycle
    x, y = loop.run(setup.y_ref[:until], stage.run)
    fixed = [learner.compensator for learner in loop.learners]
    later_x, later_y = follow(stage, fixed, setup, setup.y_ref[until:])
    x, y = np.concatenate([x, later_x]), np.concatenate([y, later_y])
    return Trial(setup, x, y, follow(stage, fixed, setup, setup.loop_ref)[1])


def follow(stage: Stage, compensators: list[Compensator], setup: StageSetup, y_ref: Matrix) -> tuple[Matrix, Matrix]:
    """Follow a reference with fixed models from the current state; drives and measured platform."""
    wanted = y_ref @ setup.decoupling.T
    x = np.column_stack([compensator.run(wanted[:, i]) for i, compensator in enumerate(compensators)])
    return x, stage.run(x)
