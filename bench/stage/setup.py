"""The set-up of the experiment: a two-axis stage, its reference, and the knowledge before learning.

The stage represents that of the paper's Fig. 3: per axis one actuator, or two in push-pull, guided by elastic joints.
Its reference is the staircase of Fig. 4 on both axes, a quarter of a period apart, so that the axes move differently. A
step of the staircase takes ``step_s``, since a jump would excite the structure's resonance.

Errors are those of the measured platform, in µm or in percent of the reference's range.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Self

import numpy as np

from piezo_model import ModelStructure, SelfLearningCompensator, plants, signals
from piezo_model.stage.axis import Axis
from piezo_model.stage.decoupling import estimate_decoupling
from piezo_model.stage.stage import Stage
from solvers.arrays import Matrix

AXES = ("x", "y")
LEVELS = 9
AMPLITUDE_UM = 16.0
RANGE_UM = 2.0 * AMPLITUDE_UM
CREEP_RATES = (100.0, 10.0, 1.0, 0.1)
COUPLING = ((1.0, 0.06), (-0.04, 1.0))
WANDER_S = 10.0
"""Length of the recording from which the decoupling is estimated."""


@dataclass(frozen=True)
class Actuators:
    """The actuator of an axis: a plant by name with its options."""

    plant: str
    options: tuple[tuple[str, float], ...] = ()
    """Pairs of name and value."""


@dataclass(frozen=True)
class StageSetup:
    """A stage with its learning phases, its reference and the orders of the model; all times in s.

    The defaults are the paper's: n = 5, m = 3, reset 0.1 s, building 8 s, learning 1.9 s, a sample every 125 µs.
    """

    actuators: tuple[Actuators, Actuators] = (Actuators("relay_preisach"), Actuators("dense_prandtl_ishlinskii"))
    push_pull: bool = False
    n: int = 5
    m: int = 3
    solver: str = "projected_difference"
    lane: str | None = None
    setting: str | None = None
    """A setting of the solver's ladder, from ``solvers.protocol.setting_text``; by default the tightest that it claims
    to reach."""
    reset_s: float = 0.1
    build_s: float = 8.0
    learn_s: float = 1.9
    cycles: int = 5
    hold_s: float = 0.25
    step_s: float = 0.02
    loops_s: float = 4.0
    sample_time: float = 125e-6
    noise_um: float = 0.002
    quantum_um: float = 0.001
    gain_drift_per_s: float = 0.0
    samples: int | None = None
    """Length of the staircases; by default ``cycles`` of the learning machine."""
    seed: int = 0

    @classmethod
    def quick(cls, **options: Any) -> Self:
        """A setup with short phases, which runs in a few seconds."""
        return cls(
            **{
                "reset_s": 0.05,
                "build_s": 2.0,
                "learn_s": 0.2,
                "cycles": 3,
                "hold_s": 0.0625,
                "step_s": 0.01,
                "loops_s": 1.0,
                **options,
            }
        )

    @property
    def cycle(self) -> int:
        """Samples of one cycle of the paper's learning machine."""
        return sum(round(seconds / self.sample_time) for seconds in (self.reset_s, self.build_s, self.learn_s))

    @property
    def period(self) -> int:
        """Samples of one period of the staircase."""
        return 2 * (LEVELS - 1) * round(self.hold_s / self.sample_time)

    def stage(self, number: int = 0) -> Stage:
        """Make the stage, at rest; every number has other noise."""

        def axis(actuators: Actuators) -> Axis:
            made = tuple(
                plants.get(actuators.plant, sample_time=self.sample_time, **dict(actuators.options))
                for _ in range(2 if self.push_pull else 1)
            )
            return Axis(actuators=made, gain_drift_per_s=self.gain_drift_per_s)

        first, second = self.actuators
        return Stage(
            axes=(axis(first), axis(second)),
            coupling=COUPLING,
            noise_um=self.noise_um,
            quantum_um=self.quantum_um,
            seed=1000 * self.seed + number,
        )

    @property
    def decoupling(self) -> Matrix:
        """D, estimated from a recording of random walks on both axes, before the experiment and any drift.

        Setups that differ in nothing else share it.
        """
        return estimated(
            StageSetup(
                self.actuators,
                self.push_pull,
                sample_time=self.sample_time,
                noise_um=self.noise_um,
                quantum_um=self.quantum_um,
                seed=self.seed,
            )
        )

    @cached_property
    def structures(self) -> tuple[ModelStructure, ModelStructure]:
        """The model structure of each axis; before learning the model is the straight line through its ranges."""
        first, second = (
            ModelStructure.equidistant(
                self.n, self.m, axis.x_range, axis.y_range, CREEP_RATES, self.sample_time, offset=True
            )
            for axis in self.stage().axes
        )
        return first, second

    def learner(self, structure: ModelStructure) -> SelfLearningCompensator:
        """A learner for one axis, which starts at the low end of its drive."""
        return SelfLearningCompensator(
            structure,
            self.reset_s,
            self.build_s,
            self.learn_s,
            self.solver,
            structure.x_range,
            x_start=structure.x_range[0],
            solver_options={"lane": self.lane, "setting": self.setting},
        )

    @cached_property
    def y_ref(self) -> Matrix:
        """Staircases for all cycles, shape (N, 2), µm."""
        quarter = self.period // 4
        count = self.samples or self.cycles * self.cycle
        steps = signals.staircase(
            duration_s=(count + quarter) * self.sample_time,
            sample_time=self.sample_time,
            low=-AMPLITUDE_UM,
            high=AMPLITUDE_UM,
            levels=LEVELS,
            hold_s=self.hold_s,
        )
        return np.column_stack(
            [
                signals.smoothed(part, self.step_s, self.sample_time)
                for part in (steps[:count], steps[quarter : quarter + count])
            ]
        )

    @cached_property
    def loop_ref(self) -> Matrix:
        """Triangles of decreasing amplitude for hysteresis loops, shape (N, 2), µm; they continue the staircases."""
        loops = []
        for i, cycles in enumerate((3.5, 4.5)):
            triangle = signals.decaying_triangle(
                duration_s=self.loops_s,
                sample_time=self.sample_time,
                low=-AMPLITUDE_UM,
                high=AMPLITUDE_UM,
                cycles=cycles,
                final_share=0.1,
            )
            loops.append(
                signals.smoothed(np.concatenate([self.y_ref[-1:, i], triangle]), self.step_s, self.sample_time)[1:]
            )
        return np.column_stack(loops)


@cache
def estimated(setup: StageSetup) -> Matrix:
    """The decoupling matrix of a setup from ``WANDER_S`` seconds."""
    stage = setup.stage(number=1)
    x = np.column_stack(
        [
            signals.random_walk(
                duration_s=WANDER_S,
                sample_time=setup.sample_time,
                low=axis.x_range[0],
                high=axis.x_range[1],
                seed=1000 * setup.seed + i,
            )
            for i, axis in enumerate(stage.axes)
        ]
    )
    return estimate_decoupling(x, stage.run(x))


def percent(error_um: Matrix) -> Matrix:
    """Errors in µm as percent of the reference's range."""
    return 100.0 / RANGE_UM * error_um
