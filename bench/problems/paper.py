"""The paper's experiment: n = 5, m = 3, d = 18, 8 s of data at 125 µs, several actuators and drives."""

from collections.abc import Mapping

from bench.problems.simulation import Experiment, Simulated
from piezo_model import plants

DRIVES = ("staircase", "multi_sine", "random_walk")


class Paper(Simulated):
    """Every simulated actuator under every drive."""

    name = "paper"
    description = "the paper's orders (n = 5, m = 3), building phase of 8 s at 125 µs, every plant under several drives"

    def experiments(self) -> Mapping[str, Experiment]:
        """Every plant under every drive."""
        return {
            f"{plant}-{drive}": Experiment(plant, drive, seed=self.seed + i)
            for plant in plants.names()
            for i, drive in enumerate(DRIVES)
        }
