"""quadprog: the dual active set method of Goldfarb and Idnani, the reference implementation of the field.

    minimise ½ xᵀP x − aᵀx   subject to   Cᵀx ≥ b, the first rows with equality;   a = −q

Source: D. Goldfarb and A. Idnani, "A numerically stable dual method for solving strictly convex quadratic programs",
Mathematical Programming 27 (1983), pages 1 to 33; B. Turlach's code.

Timed: ``setup`` stacks the rows; ``update`` copies P and q; ``solve`` is the library's one function, which copies,
factorises and iterates. There is no object to keep, no tolerance to set and no warm start.
"""

import numpy as np
import quadprog
from qpsolvers import Problem, Solution

from solvers import backend as known
from solvers.backend import LibrarySolver
from solvers.protocol import Matrix, Vector
from solvers.rows import Cones, Program

NO_ANSWER = ("no solution", "not positive definite")  # what the library's ValueError says when the problem is at fault


class Quadprog(LibrarySolver):
    """The library's function ``solve_qp``."""

    name = "quadprog"
    library = known.QUADPROG

    def setup(self, problem: Problem) -> None:  # noqa: D102
        if self.settings:
            raise ValueError(f"quadprog has no settings, so none is {', '.join(sorted(self.settings))}")
        self.program = Program(problem)
        self._rows = Cones(self.program)
        self._a = -self.program.q
        some = self._rows.r.size > 0
        self._constraints = (np.ascontiguousarray(-self._rows.R.T), -self._rows.r, self._rows.equal) if some else ()

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:  # noqa: D102
        self.program.take(P, q)
        np.negative(self.program.q, out=self._a)

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        try:
            answer = quadprog.solve_qp(self.program.P, self._a, *self._constraints)
        except ValueError as error:
            if not str(error).endswith(NO_ANSWER):
                raise
            self._found, self._status = False, str(error)
            return self.program.no_answer()
        self._found, self._status = True, "solved"
        x: Vector = answer[0]
        self._x, self._iterations, self._lagrangian = x, int(answer[3][0]), answer[4]
        return x

    def solution(self) -> Solution:  # noqa: D102
        p = self.program
        if not self._found:
            return p.solution(
                p.no_answer(), np.zeros(p.l.size), False, status=self._status, reported_us=None, iterations=None
            )
        w = self._rows.distribute(self._lagrangian if self._rows.r.size else np.zeros(0))
        return p.solution(self._x, w, True, status=self._status, reported_us=None, iterations=self._iterations)
