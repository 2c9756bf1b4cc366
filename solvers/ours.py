"""Base classes of the solvers that were written for this project."""

from solvers.core import BUILT_WITH, CAPPED, OK, REASONS
from solvers.protocol import Entrant, Lane, Solver


class Ours(Entrant):
    """Licence, package and compiler of our solvers."""

    licence = "MIT"
    distribution = "piezobench"
    built_with = BUILT_WITH


class OurSolver(Ours, Solver):
    """A solver of the lane kernel whose compiled functions return a status."""

    lane = Lane.KERNEL

    def accept(self, status: int) -> None:
        """Raise ValueError unless the status is that of an answer."""
        if status not in (OK, CAPPED):
            raise ValueError(f"{self.name}: {REASONS[status]}")
