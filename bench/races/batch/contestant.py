"""What takes part in a batch race, and which files define it."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from qpsolvers import Problem

from solvers import Lane, find
from solvers.arrays import Matrix
from solvers.protocol import Entrant, Solver
from solvers.registry import Entry

DIRECT = ("box_active_set", "daqp", "mujoco", "pyqpmad", "quadprog")
"""The quickest solvers of the lane direct."""


class Contestant(Entrant):
    """Solves batches of programs  minimise ½ xᵀP x + qᵀx  subject to  lb ≤ x ≤ ub  of d variables, with so many threads
    at most.

    It asks its library for what it takes to be right to 1e-9 in the relative cost, where the library can. In the lane
    direct it has one thread.
    """

    compiles: ClassVar[bool] = False
    """Whether it compiles anew for each size of a batch, which is done before it is timed."""

    def __init__(self, d: int, threads: int) -> None:
        self.d, self.threads = d, threads

    @abstractmethod
    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> Matrix:
        """The answers (B, d) to the programs P (B, d, d) with q, lb, ub (B, d); NaN where there is none."""


class OneByOne(Contestant):
    """A solver of the lane direct, which is handed one program after the other; set up again where their bounds
    change."""

    solver: ClassVar[type[Solver]]

    def __init__(self, d: int, threads: int) -> None:
        super().__init__(d, threads)
        self._solver, self._lb, self._ub = self.solver(), np.full(d, np.nan), np.full(d, np.nan)

    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> Matrix:
        """One after the other."""
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
    """One contestant, known by its file and not yet imported; in the lane direct, where the file is not a user's, a
    solver of that lane."""

    base = Contestant

    def load(self) -> type[Any]:
        """Import the contestant's class; ImportError where its library is not installed."""
        if self.lane is Lane.KERNEL or self.path is not None:
            return super().load()
        solver = find(self.name, self.lane).load()
        return type(
            self.name,
            (OneByOne,),
            {
                "solver": solver,
                "algorithm": solver.algorithm,
                "licence": solver.licence,
                "distribution": solver.distribution,
            },
        )


def contestants() -> Iterator[ContestantFile]:
    """All that there are, by lane and name."""
    folder = Path(__file__).parent / "contestants"
    for file in sorted(folder.glob("[a-z]*.py")):
        yield ContestantFile(file.stem, Lane.KERNEL, f"{__package__}.contestants.{file.stem}")
    for name in DIRECT:
        yield ContestantFile(name, Lane.DIRECT, "")


def of_file(path: str | Path) -> ContestantFile:
    """The contestant of a user's own file, in the lane direct; ImportError where it is none."""
    path = Path(path).resolve()
    entry = ContestantFile(path.stem, Lane.DIRECT, f"piezobench_user_{path.stem}", path)
    entry.load()
    return entry
