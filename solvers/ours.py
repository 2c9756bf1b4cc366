"""Base classes of the solvers that were written for this project."""

from collections.abc import Mapping

from solvers.core import BUILT_WITH, CAPPED, OK, REASONS
from solvers.protocol import Entrant, Lane, Solver, Vector


class Ours(Entrant):
    """Licence, package and compiler of our solvers."""

    licence = "MIT"
    distribution = "piezobench"
    built_with = BUILT_WITH


class OurSolver(Ours, Solver):
    """A solver of the lane kernel whose compiled functions return a status."""

    lane = Lane.KERNEL
    _parts: Mapping[str, Vector]

    def part(self, name: str) -> Vector:
        """Return a view of a part of the state, by its name in ``bindings_*.c``."""
        return self._parts[name]

    def accept(self, status: int) -> None:
        """Raise ValueError unless the status is that of an answer."""
        if status not in (OK, CAPPED):
            raise ValueError(f"{self.name}: {REASONS[status]}")
