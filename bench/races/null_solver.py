"""The solver that does nothing: on the schedule of a race it shows what the machine itself does to response times."""

import numpy as np
from qpsolvers import Problem, Solution

from solvers.protocol import Lane, Matrix, Solver, Vector, box, box_solution
from solvers.registry import Entry


class NullSolver(Solver):
    """Returns the answer that it is given to start from, at once."""

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
        """Take no notice."""

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the previous answer, shape (d,)."""
        if warm_start is not None:
            self._x = warm_start
        return self._x

    def solution(self) -> Solution:
        """Return it as no answer."""
        return box_solution(self._problem, self._x, False, status="did nothing")


ENTRY = Entry(NullSolver.name, NullSolver.lane, NullSolver.__module__)
