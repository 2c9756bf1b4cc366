"""A missed answer as a file: the program, the answer, the proven optimum, and what the solver was set to."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from qpsolvers import Problem

from bench.problem_files.npz import opened, packed_program, unpacked_program
from piezo_model.atomic_file import replacing
from piezo_model.json_file import decoded
from solvers import Lane, Solver, get
from solvers.arrays import Vector
from solvers.protocol import dense


@dataclass(frozen=True)
class Miss:
    """An answer that misses 1e-9.

    Examples
    --------
    >>> qp = Problem(np.eye(1), -np.ones(1), lb=np.zeros(1))
    >>> miss = Miss("daqp", "direct", "{}", qp, qp, np.zeros(1), np.ones(1), 1.0)
    >>> miss.gap(miss.x), miss.gap(miss.solve())
    (0.5, 0.0)
    """

    solver: str
    lane: str
    settings: str
    """JSON."""
    first: Problem
    """The program of the set-up, which the data of the missed call follow by an update."""
    qp: Problem
    """The program of the missed call."""
    x: Vector
    """The missed answer (d,); empty if there was none."""
    optimum: Vector
    """The proven optimum (d,), rounded."""
    unit: float
    """What a cost is divided by to be a relative gap."""

    def solve(self, solver: Solver | None = None) -> Vector:
        """The answer (d,) now, of this solver at these settings, or of another one that is ready to be set up."""
        solver = solver or get(self.solver, lane=Lane(self.lane), **decoded(self.settings, dict[str, Any]))
        solver.setup(self.first)
        P, q = dense(self.qp)
        solver.update(P=None if np.array_equal(P, dense(self.first)[0]) else P, q=q)  # as the race did
        return np.array(solver.solve())

    def gap(self, x: Vector) -> float:
        """Cost of x above that of the optimum, relative and in doubles; negative outside the constraints."""
        cost, least = (float(0.5 * z @ (self.qp.P @ z) + self.qp.q @ z) for z in (x, self.optimum))
        return (cost - least) / self.unit

    def save(self, path: Path) -> None:
        """Write an NPZ file."""
        others = {name: getattr(self, name) for name in ("solver", "lane", "settings", "x", "optimum", "unit")}
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **packed_program(self.qp), **packed_program(self.first, "first/"), **others)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file of :meth:`save`; ProblemFileError for another one."""
        with opened(Path(path)) as data:
            solver, lane, settings = (str(data[name]) for name in ("solver", "lane", "settings"))
            first, qp = (unpacked_program(data, prefix) for prefix in ("first/", ""))
            return cls(solver, lane, settings, first, qp, data["x"], data["optimum"], float(data["unit"]))
