"""The null solver, which does nothing: its times are the floor of the machine, clock and call included."""

import numpy as np
from qpsolvers import Problem, Solution

from solvers.protocol import Lane, Matrix, Solver, Vector, box, box_solution
from solvers.registry import Entry


class NullSolver(Solver):
    """Returns its start at once."""

    name = "null"
    lane = Lane.DIRECT
    algorithm = "none, the machine's floor"
    licence = "MIT"
    distribution = "piezobench"
    warm_startable = True

    def setup(self, problem: Problem) -> None:
        """Keep the problem."""
        self._problem = problem
        self._x: Vector = np.clip(np.zeros(problem.q.shape[0]), *box(problem))

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Ignore the data."""

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the start, by default the previous answer, shape (d,)."""
        if warm_start is not None:
            self._x = warm_start
        return self._x

    def solution(self) -> Solution:
        """Return the answer, marked as not found."""
        return box_solution(self._problem, self._x, False, status="did nothing")


ENTRY = Entry(NullSolver.name, NullSolver.lane, NullSolver.__module__)
