"""A simulated two-axis stage with its reference and learners, and its runs along a straight line or with learning.

The stage represents that of the paper's Fig. 3: per axis one actuator, or two in push-pull, in elastic joints.

    y(k) = Q( C p(k) + σ ν(k) ),   p_i the displacement of axis i, which depends on the drive x_i alone
    q_r = D y_r,   x_i = learner i (q_r,i, q_i),   q = D y

The joints couple the axes by C, and D, estimated from recordings, decouples them, so that the two loops are
independent. The reference is the staircase of Fig. 4 on both axes, a quarter of a period apart, so that the axes move
differently. A step takes ``step_s``, since a jump would excite the resonance. All runs start from the same rest.

Errors are those of the measured platform in µm, or in percent of the reference's range.
"""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from piezo_model import Compensator, Dynamics, ModelStructure, SelfLearningCompensator, plants
from piezo_model.signals import decaying_triangle, smoothed, staircase
from solvers.arrays import Matrix, Vector

AXES = ("x", "y")
LEVELS = 9
AMPLITUDE_UM = 16.0
RANGE_UM = 2.0 * AMPLITUDE_UM
CREEP_RATES = (100.0, 10.0, 1.0, 0.1)
COUPLING = np.array([[1.0, 0.06], [-0.04, 1.0]])
STRUCTURE = Dynamics((800.0,), (0.1,), (1.0,), 0.0)
NOISE_UM, QUANTUM_UM = 0.002, 0.001
SETTLING_S = 60.0
"""Time for which an opposing actuator has been at its high end."""
RECORDED_S = 2.0
"""Length of the recording of each axis from which the decoupling is estimated."""
HINDSIGHT_ROUNDS = 4
QUICK: dict[str, Any] = {
    "reset_s": 0.05,
    "build_s": 2.0,
    "learn_s": 0.2,
    "cycles": 3,
    "hold_s": 0.0625,
    "step_s": 0.01,
    "loops_s": 1.0,
}
"""Short phases, which run in a few seconds."""
Actuators = tuple[str, dict[str, float]]
"""The actuators of an axis: a plant by name, and its options."""


class PushPull(plants.Plant):
    """Two opposing actuators, which move the platform by half their difference, so that an even part cancels."""

    def __init__(self, pushing: plants.Plant, pulling: plants.Plant) -> None:
        self.pushing, self.pulling = pushing, pulling
        self.x_range, self.y_range, self.sample_time = pushing.x_range, pushing.y_range, pushing.sample_time
        self.reset()

    def run(self, x: ArrayLike) -> Vector:
        """Continue with a drive."""
        return 0.5 * (self.pushing.run(x) - self.pulling.run(sum(self.x_range) - np.asarray(x)))

    def reset(self) -> None:
        """Go to rest at the low end of the drive, the opposing actuator at its high end."""
        self.pushing.reset()
        self.pulling.reset()
        self.pulling.run(np.full(round(SETTLING_S / self.sample_time), self.x_range[1]))


class Stage:
    """The two axes and their sensors."""

    def __init__(self, axes: Sequence[plants.Plant], seed: int) -> None:
        self.axes, self.random = axes, np.random.default_rng(seed)

    def run(self, x: Matrix) -> Matrix:
        """Continue with drives (N, 2) in V; measured displacements (N, 2) of the platform in µm."""
        y = np.column_stack([axis.run(x[:, i]) for i, axis in enumerate(self.axes)]) @ COUPLING.T
        return QUANTUM_UM * np.round((y + NOISE_UM * self.random.standard_normal(y.shape)) / QUANTUM_UM)


@dataclass(frozen=True)
class Setup:
    """A stage with its learning phases, its reference and the orders of the model; all times in s.

    The defaults are the paper's: n = 5, m = 3, reset 0.1 s, building 8 s, learning 1.9 s, a sample every 125 µs.
    """

    actuators: tuple[Actuators, Actuators] = (("relay_preisach", {}), ("dense_prandtl_ishlinskii", {}))
    push_pull: bool = False
    n: int = 5
    m: int = 3
    solver: str = "projected_difference"
    solver_options: dict[str, Any] = field(default_factory=dict)
    reset_s: float = 0.1
    build_s: float = 8.0
    learn_s: float = 1.9
    cycles: int = 5
    hold_s: float = 0.25
    step_s: float = 0.02
    loops_s: float = 4.0
    sample_time: float = 125e-6
    gain_drift_per_s: float = 0.0
    seed: int = 0

    @property
    def cycle(self) -> int:
        """Samples of one cycle of the paper's learning machine."""
        return sum(round(seconds / self.sample_time) for seconds in (self.reset_s, self.build_s, self.learn_s))

    @property
    def period(self) -> int:
        """Samples of one period of the staircase."""
        return 2 * (LEVELS - 1) * round(self.hold_s / self.sample_time)

    def axis(self, name: str, options: dict[str, float]) -> plants.Plant:
        """One axis at rest at the low end of its drive: actuators, drift of their gain, elastic joints."""
        made = [plants.get(name, sample_time=self.sample_time, **options) for _ in range(2)]
        drifting = plants.Sensor(PushPull(*made) if self.push_pull else made[0], gain_drift_per_s=self.gain_drift_per_s)
        return plants.Flexure(drifting, STRUCTURE)

    def stage(self, number: int = 0) -> Stage:
        """Make the stage, at rest; every number has other noise."""
        return Stage([self.axis(*each) for each in self.actuators], 1000 * self.seed + number)

    @cached_property
    def decoupling(self) -> Matrix:
        """D, estimated from recordings in which one axis moves and the other rests: both outputs are then multiples of
        one displacement, and their ratio is an entry of C over one of its diagonal."""
        columns = []
        for i in range(len(AXES)):
            stage = self.stage(1 + i)
            low, high = np.array([axis.x_range for axis in stage.axes]).T
            swing = np.sin(np.pi * np.linspace(0.0, 1.0, round(RECORDED_S / self.sample_time))) ** 2
            y = stage.run(low + np.outer(swing, (high - low) * np.eye(len(AXES))[i]))
            y -= y.mean(axis=0)
            columns.append(y.T @ y[:, i] / (y[:, i] @ y[:, i]))
        return np.asarray(np.linalg.inv(np.column_stack(columns)))

    @cached_property
    def structures(self) -> list[ModelStructure]:
        """The model structure of each axis; before learning the model is the straight line through its ranges."""
        return [
            ModelStructure.equidistant(
                self.n, self.m, axis.x_range, axis.y_range, CREEP_RATES, self.sample_time, offset=True
            )
            for axis in self.stage().axes
        ]

    def learners(self) -> list[SelfLearningCompensator]:
        """A learner for each axis, which starts at the low end of its drive."""
        return [
            SelfLearningCompensator(
                structure,
                self.reset_s,
                self.build_s,
                self.learn_s,
                self.solver,
                structure.x_range,
                x_start=structure.x_range[0],
                solver_options=self.solver_options,
            )
            for structure in self.structures
        ]

    @cached_property
    def y_ref(self) -> Matrix:
        """Staircases for all cycles, shape (N, 2), µm."""
        quarter, count = self.period // 4, self.cycles * self.cycle
        steps = staircase(
            duration_s=(count + quarter) * self.sample_time,
            sample_time=self.sample_time,
            low=-AMPLITUDE_UM,
            high=AMPLITUDE_UM,
            levels=LEVELS,
            hold_s=self.hold_s,
        )
        parts = steps[:count], steps[quarter : quarter + count]
        return np.column_stack([smoothed(part, self.step_s, self.sample_time) for part in parts])

    @cached_property
    def loop_ref(self) -> Matrix:
        """Triangles of decreasing amplitude for hysteresis loops, shape (M, 2), µm; they continue the staircases."""
        triangles = [
            decaying_triangle(
                duration_s=self.loops_s,
                sample_time=self.sample_time,
                low=-AMPLITUDE_UM,
                high=AMPLITUDE_UM,
                cycles=cycles,
                final_share=0.1,
            )
            for cycles in (3.5, 4.5)
        ]
        whole = np.vstack([self.y_ref[-1], np.column_stack(triangles)])
        return np.column_stack([smoothed(part, self.step_s, self.sample_time)[1:] for part in whole.T])


@dataclass(frozen=True, eq=False)
class Trial:
    """The record of a run."""

    setup: Setup
    x: Matrix
    y: Matrix
    """Drives in V and measured platform in µm along ``setup.y_ref``. Shape (N, 2)."""
    loop: Matrix
    """Measured platform along ``setup.loop_ref`` directly afterwards, without learning. Shape (M, 2)."""
    learners: Sequence[SelfLearningCompensator] = ()

    @property
    def errors(self) -> Matrix:
        """Tracking error in percent of the reference's range, by cycle, sample and axis."""
        return 100.0 / RANGE_UM * (self.y - self.setup.y_ref).reshape(self.setup.cycles, -1, len(AXES))

    @property
    def rms(self) -> Matrix:
        """RMS of these errors by cycle and axis."""
        return np.asarray(np.sqrt(np.mean(self.errors**2, axis=1)))


def setup_of(given: Namespace, **options: Any) -> Setup:
    """The paper's setup, or the shorter one with ``--quick``."""
    return Setup(**{**(QUICK if given.quick else {}), "seed": given.seed, **options})


def lines(setup: Setup) -> tuple[Vector, Vector]:
    """Slopes (V/µm) and offsets (V) of the straight lines through the corners of the ranges, (2,) each."""
    slope = np.array([s.x_scale / s.y_scale for s in setup.structures])
    return slope, np.array([s.x_centre - k * s.y_centre for s, k in zip(setup.structures, slope, strict=True)])


def straight(setup: Setup, slope: Vector, offset_V: Vector) -> Trial:
    """Drive along straight lines with these slopes and offsets."""
    stage = setup.stage()
    low, high = np.array([axis.x_range for axis in stage.axes]).T
    x, after = (
        np.clip(slope * (y_ref @ setup.decoupling.T) + offset_V, low, high) for y_ref in (setup.y_ref, setup.loop_ref)
    )
    return Trial(setup, x, stage.run(x), stage.run(after))


def best_straight(setup: Setup) -> Trial:
    """Drive along the straight lines with the least mean square error over the last cycle, found in hindsight.

    Gauss-Newton on slope and offset of the drive; to first order q follows them as (q_r, 1) times the inverse slope.
    """
    slope, offset_V = lines(setup)
    wanted = (setup.y_ref @ setup.decoupling.T)[-setup.cycle :]
    for _ in range(HINDSIGHT_ROUNDS):
        reached = (straight(setup, slope, offset_V).y @ setup.decoupling.T)[-setup.cycle :]
        turn, shift = np.array([np.polyfit(wanted[:, i], (wanted - reached)[:, i], 1) for i in range(len(AXES))]).T
        offset_V, slope = offset_V + slope * shift, slope * (1.0 + turn)
    return straight(setup, slope, offset_V)


def learned(setup: Setup, cycles: int | None = None) -> Trial:
    """Follow the reference while learning, then the triangles with the last model.

    With ``cycles`` learning stops after that many, and the model is kept, as in a compensator that is made before
    start-up.
    """
    stage, learners, q_ref = setup.stage(), setup.learners(), setup.y_ref @ setup.decoupling.T
    x, y, done = np.empty_like(q_ref), np.empty_like(q_ref), 0
    until = len(q_ref) if cycles is None else cycles * setup.cycle
    while done < until:  # in parts that end where the weights of either axis may change
        part = slice(done, min([until, *(done + learner.samples_until_change() for learner in learners)]))
        x[part] = np.column_stack([learner.drive(q_ref[part, i]) for i, learner in enumerate(learners)])
        y[part] = stage.run(x[part])
        for i, learner in enumerate(learners):
            learner.observe(x[part, i], y[part] @ setup.decoupling[i])
        done = part.stop
    fixed = [
        Compensator(learner.model, learner.settings.x_limits, state=learner.compensator.state) for learner in learners
    ]
    x[until:] = drives(fixed, q_ref[until:])
    y[until:] = stage.run(x[until:])
    return Trial(setup, x, y, stage.run(drives(fixed, setup.loop_ref @ setup.decoupling.T)), learners)


def drives(compensators: Sequence[Compensator], q_ref: Matrix) -> Matrix:
    """Drives (N, 2) with models that stay as they are, from the current state."""
    return np.column_stack([compensator.run(q_ref[:, i]) for i, compensator in enumerate(compensators)])
