"""The paper's experiment: n = 5, m = 3, d = 18, 8 s of data at 125 µs, several actuators and drives."""

from __future__ import annotations

from collections.abc import Iterator

from bench.problems.protocol import ProblemSet, RaceProblem
from bench.problems.simulation import Experiment
from piezo_model import plants

DRIVES = ("staircase", "multi_sine", "random_walk")


class Paper(ProblemSet):
    """Every simulated actuator under every drive."""

    name = "paper"
    description = "the paper's orders (n = 5, m = 3), building phase of 8 s at 125 µs, every plant under several drives"

    def __len__(self) -> int:
        """Plants times drives."""
        return len(plants.names()) * len(DRIVES)

    def problems(self) -> Iterator[RaceProblem]:
        """Drive, measure, accumulate and certify."""
        for plant in plants.names():
            for i, drive in enumerate(DRIVES):
                yield Experiment(plant, drive, seed=self.seed + i).problem(self.name, f"{plant}-{drive}")
