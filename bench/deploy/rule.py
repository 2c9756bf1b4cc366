"""The rule of a decision."""

from dataclasses import dataclass

from bench.timing.schedule import PERIOD_US
from solvers import Lane

QUANTILES = (0.999, 0.99, 0.5)
"""The first one for which every qualified candidate has enough calls decides."""


@dataclass(frozen=True)
class Rule:
    """Requirements on a solver."""

    accuracy: float = 1e-9
    """Largest relative cost gap and violation."""
    deadline_us: float = PERIOD_US
    """Sampling period of the controller."""
    lanes: tuple[Lane, ...] = (Lane.KERNEL, Lane.DIRECT)
    """Lanes that the controller can run."""
    misses: int = 0
    """Most deadlines missed beyond the floor."""

    @property
    def sentence(self) -> str:
        """The rule in words."""
        return (
            f"cost gap and violation of at most {self.accuracy:g} on every problem, by first and timed answers, at "
            f"most {self.misses} "
            f"deadlines of {self.deadline_us:g} µs missed beyond those that the machine itself misses, then the "
            f"lowest p99.9; lanes {', '.join(self.lanes)}."
        )
