"""Certified problems of a simulated actuator under a drive; most problem sets consist of them.

No actuator is in the model class. Each starts at the low end of its major loop, is driven for the building phase and
measured with noise and quantisation; the unseen data for validation follow, under another drive.
"""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.problems.protocol import ProblemSet, RaceProblem, Validation, certified
from piezo_model import DataBasis, ModelStructure, OperatorState, plants
from piezo_model.signals import SIGNALS, decaying_triangle
from solvers.arrays import Vector

SAMPLE_TIME = 125e-6
VALIDATION_S = 2.0
CREEP_RATES = (100.0, 10.0, 1.0, 0.1)
NEIGHBOURS = (0.25, 0.5, 0.75)
"""Shares of the building phase that are its neighbouring windows."""
SEEDED = ("multi_sine", "random_walk")
"""Signals with a random seed."""


@dataclass(frozen=True)
class Experiment:
    """One building phase."""

    plant: str
    drive: str
    """Names of a simulated actuator and of a signal."""
    n: int = 5
    m: int = 3
    """Orders of the model."""
    build_s: float = 8.0
    """Length of the building phase in s."""
    reach: float = 1.0
    """Share of the input range that the drive covers, from the low end up."""
    noise: float = 2e-4
    """Standard deviation of the sensor's noise relative to the output range; the quantum is half of it."""
    drift_per_s: float = 0.0
    """Relative change of the actuator's gain per second."""
    proximal: float = 1e-10
    """Proximal term, see ``IdentificationProblem``."""
    seed: int = 0

    def measured(self, duration_s: float, forgetting: float = 1.0) -> tuple[plants.Sensor, Vector, Vector, DataBasis]:
        """Actuator with its sensor, input and output over a duration from rest, and an empty data basis.

        The thresholds cover the full input range and the output range of the building phase.
        """
        actuator = plants.get(self.plant, sample_time=SAMPLE_TIME)
        (low, high), noise_um = actuator.x_range, self.noise * (actuator.y_range[1] - actuator.y_range[0])
        plant = plants.Sensor(
            actuator, noise_um=noise_um, quantum_um=noise_um / 2.0, gain_drift_per_s=self.drift_per_s, seed=self.seed
        )
        options = {"seed": self.seed} if self.drive in SEEDED else {}
        x = SIGNALS[self.drive](
            duration_s=duration_s, sample_time=SAMPLE_TIME, low=low, high=low + self.reach * (high - low), **options
        )
        y, built = plant.run(x), round(self.build_s / SAMPLE_TIME)
        y_range = centred_range(x[:built], y[:built], self.reach)
        structure = ModelStructure.equidistant(self.n, self.m, plant.x_range, y_range, CREEP_RATES, SAMPLE_TIME)
        return plant, x, y, DataBasis(structure, OperatorState.settled_at(structure, low), forgetting)

    def problem(self, set_name: str, name: str) -> RaceProblem:
        """Drive, measure, accumulate and certify."""
        plant, x, y, basis = self.measured(self.build_s)
        neighbours, done = [], 0
        for end in (*(round(share * x.size) for share in NEIGHBOURS), x.size):
            basis.update(x[done:end], y[done:end])
            neighbours.append(basis.problem(proximal=self.proximal))
            done = end
        *neighbours, problem = neighbours
        unseen = decaying_triangle(duration_s=VALIDATION_S, sample_time=SAMPLE_TIME, low=x.min(), high=x.max())
        validation = Validation(basis.structure, basis.state.copy(), unseen, plant.run(unseen), plant.noise_um)
        return certified(set_name, name, problem, validation, neighbours=neighbours)


class Simulated(ProblemSet):
    """A problem set of experiments."""

    @abstractmethod
    def experiments(self) -> Mapping[str, Experiment]:
        """The experiment of each problem by name."""

    def names(self) -> Sequence[str]:
        """Names of the experiments."""
        return [*self.experiments()]

    def problems(self) -> Iterator[RaceProblem]:
        """Drive, measure, accumulate and certify."""
        for name, experiment in self.experiments().items():
            if name in self.wanted:
                yield experiment.problem(self.name, name)


def centred_range(x: Vector, y: Vector, reach: float = 1.0) -> tuple[float, float]:
    """Range of y about the centre of its loop, halfway between both branches at the middle of x.

    The paper's model has no constant term, so zero must be the centre of its point-symmetric hysteresis. If the drive
    covers only a share of its range, the range of y is stretched accordingly.
    """
    middle = np.abs(x - 0.5 * (x.min() + x.max())) < 0.02 * np.ptp(x)
    centre = 0.5 * (y[middle].min() + y[middle].max())
    half = float(np.max(np.abs(y - centre)))
    if reach < 1.0:  # the covered part lies at the low end
        low = centre - half
        return low, low + 2.0 * half / reach
    return centre - half, centre + half
