"""What the sensor does to the problem: noise and quantisation from none to one per cent of the range."""

from __future__ import annotations

from collections.abc import Iterator

from bench.problems.protocol import ProblemSet, RaceProblem
from bench.problems.simulation import Experiment

LEVELS = (0.0, 1e-5, 1e-4, 1e-3, 1e-2)


class Noise(ProblemSet):
    """The dense Prandtl–Ishlinskii actuator under a multi-sine, measured worse and worse."""

    name = "noise"
    description = "the same building phase measured with noise from none to 1 % of the range"

    def __len__(self) -> int:
        """Number of levels."""
        return len(LEVELS)

    def problems(self) -> Iterator[RaceProblem]:
        """One problem a level."""
        for level in LEVELS:
            experiment = Experiment("dense_prandtl_ishlinskii", "multi_sine", noise=level, seed=self.seed)
            yield experiment.problem(self.name, f"noise-{level:.0e}" if level else "noise-none")
