"""The paper's experiment: n = 5, m = 3, d = 18, 8 s of data at 125 µs, several actuators and drives.

No actuator is in the class of the model, and each is measured with noise and quantisation. The two seconds that follow
the building phase, under another drive, are kept back to judge the model with.
"""

from __future__ import annotations

from collections.abc import Iterator

from bench.problems.protocol import ProblemSet, RaceProblem, Validation, certified
from piezo_model import DataBasis, ModelStructure, OperatorState, plants
from piezo_model.signals import SIGNALS, decaying_triangle

SAMPLE_TIME = 125e-6
BUILD_S = 8.0
VALIDATION_S = 2.0
CREEP_RATES = (100.0, 10.0, 1.0, 0.1)
DRIVES = ("staircase", "multi_sine", "random_walk")
NOISE = 2e-4
"""Standard deviation of the sensor's noise as a share of the output's range, and half the quantum."""


class Paper(ProblemSet):
    """Every simulated actuator under every drive."""

    name = "paper"
    description = "the paper's orders (n = 5, m = 3), building phase of 8 s at 125 µs, every plant under several drives"

    def __len__(self) -> int:
        """Plants times drives."""
        return len(plants.names()) * len(DRIVES)

    def problems(self) -> Iterator[RaceProblem]:
        """Drive, measure, accumulate and certify."""
        for plant_name in plants.names():
            for i, drive in enumerate(DRIVES):
                yield self._problem(plant_name, drive, self.seed + i)

    def _problem(self, plant_name: str, drive: str, seed: int) -> RaceProblem:
        actuator = plants.get(plant_name, sample_time=SAMPLE_TIME)
        span = actuator.y_range[1] - actuator.y_range[0]
        plant = plants.Sensor(actuator, noise_um=NOISE * span, quantum_um=NOISE * span / 2.0, seed=seed)
        low, high = actuator.x_range
        options = {"seed": seed} if drive in ("multi_sine", "random_walk") else {}
        x = SIGNALS[drive](duration_s=BUILD_S, sample_time=SAMPLE_TIME, low=low, high=high, **options)
        y = plant.run(x)
        structure = ModelStructure.equidistant(5, 3, actuator.x_range, (y.min(), y.max()), CREEP_RATES, SAMPLE_TIME)
        basis = DataBasis(structure, OperatorState.at_rest(structure, -1.0))
        basis.update(x, y)
        unseen = decaying_triangle(duration_s=VALIDATION_S, sample_time=SAMPLE_TIME, low=low, high=high)
        validation = Validation(structure, basis.state.copy(), unseen, plant.run(unseen), NOISE * span)
        return certified(self.name, f"{plant_name}-{drive}", basis.problem(), validation)
