"""What takes part in a batch race, and which files define it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from solvers import Lane
from solvers.arrays import Matrix, Vector
from solvers.protocol import Entrant
from solvers.registry import Entry

FOLDERS = (Lane.KERNEL, Lane.DIRECT)


class Contestant(Entrant):
    """Solves batches of programs  minimise ½ xᵀP x + qᵀx  subject to  lb ≤ x ≤ ub  of d variables, with so many threads at most.

    It asks its library for what it takes to be right to 1e-9 in the relative cost, where the library can. In the lane direct it has one thread.
    """

    compiles: ClassVar[bool] = False
    """Whether it compiles anew for each size of a batch, which is done before it is timed."""

    def __init__(self, d: int, threads: int) -> None:
        self.d, self.threads = d, threads

    @abstractmethod
    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> Matrix:
        """The answers (B, d) to the programs P (B, d, d) with q, lb, ub (B, d); NaN where there is none."""


class Loop(Contestant):
    """A contestant that answers one program after the other."""

    @abstractmethod
    def one(self, P: Matrix, q: Vector, lb: Vector, ub: Vector) -> Vector:
        """The answer (d,) to one program; it is copied at once."""

    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> Matrix:
        """Call ``one`` for each."""
        x, one = np.empty(q.shape), self.one
        for b in range(len(q)):
            x[b] = one(P[b], q[b], lb[b], ub[b])
        return x


@dataclass(frozen=True)
class ContestantFile(Entry):
    """One contestant, known by its file and not yet imported."""

    base = Contestant


def contestants() -> Iterator[ContestantFile]:
    """All of the folder, by lane and name."""
    for lane in FOLDERS:
        for file in sorted((Path(__file__).parent / "contestants" / lane).glob("[a-z]*.py")):
            yield ContestantFile(file.stem, lane, f"{__package__}.contestants.{lane}.{file.stem}")


def of_file(path: str | Path) -> ContestantFile:
    """The contestant of a user's own file, in the lane direct; ImportError where it is none."""
    path = Path(path).resolve()
    entry = ContestantFile(path.stem, Lane.DIRECT, f"piezobench_user_{path.stem}", path)
    entry.load()
    return entry
