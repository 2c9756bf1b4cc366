"""Contestants of a batch race, and the files that define them.

A contestant is either a class of this race, compiled code that is called once for a whole batch, or a solver of the
lane direct, which :class:`OneByOne` calls for one program after the other.
"""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from qpsolvers import Problem

from solvers import Entry, Lane, find
from solvers.protocol import Entrant, Matrix, Solver

DIRECT = ("box_active_set", "daqp", "mujoco", "pyqpmad", "quadprog")
"""The fastest solvers of the lane direct."""


class Contestant(Entrant):
    """Solves batches of programs  minimise ½ xᵀP x + qᵀx  subject to  lb ≤ x ≤ ub  of d variables.

    Its settings aim at a relative cost gap of 1e-9, if the library has such settings. It uses at most ``threads``
    threads, in the lane direct one.
    """

    compiles: ClassVar[bool] = False
    """Whether it compiles for each batch size; compilation is not timed."""

    def __init__(self, d: int, threads: int) -> None:
        self.d, self.threads = d, threads

    @abstractmethod
    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> Matrix:
        """Answers (B, d) to the programs P (B, d, d) with q, lb, ub (B, d); NaN for a program without an answer."""


class OneByOne:
    """Calls a solver of the lane direct for one program after the other; sets it up again when the bounds change."""

    compiles = False

    def __init__(self, solver: Solver, d: int) -> None:
        self._solver, self._lb, self._ub = solver, np.full(d, np.nan), np.full(d, np.nan)

    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> Matrix:
        """Answers to the programs, as of :class:`Contestant`."""
        x, solver = np.empty(q.shape), self._solver
        changed = ((lb != np.vstack([self._lb, lb[:-1]])) | (ub != np.vstack([self._ub, ub[:-1]]))).any(axis=1)
        for b in range(len(q)):
            if changed[b]:
                solver.setup(Problem(P[b], q[b], lb=lb[b], ub=ub[b]))
            else:
                solver.update(P=P[b], q=q[b])
            x[b] = solver.solve()
        self._lb, self._ub = lb[-1], ub[-1]
        return x


@dataclass(frozen=True)
class ContestantFile(Entry):
    """A file that defines a contestant; not yet imported."""

    base = Contestant


def contestants() -> Iterator[Entry]:
    """All contestants by lane and name."""
    folder = Path(__file__).parent / "contestants"
    for file in sorted(folder.glob("[a-z]*.py")):
        yield ContestantFile(file.stem, Lane.KERNEL, f"{__package__}.contestants.{file.stem}")
    for name in DIRECT:
        yield find(name, Lane.DIRECT)


def of_file(path: str | Path) -> ContestantFile:
    """The contestant of a user's own file, in the lane direct; ImportError if the file defines none."""
    path = Path(path).resolve()
    entry = ContestantFile(path.stem, Lane.DIRECT, f"piezobench_user_{path.stem}", path)
    entry.load()
    return entry
