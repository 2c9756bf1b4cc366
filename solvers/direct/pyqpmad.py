"""qpmad: the dual active set method of Goldfarb and Idnani in C++ (Eigen), simple bounds treated apart from rows.

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub,  l ≤ R x ≤ u

Source: D. Goldfarb and A. Idnani, "A numerically stable dual method for solving strictly convex quadratic programs",
Mathematical Programming 27 (1983), pages 1 to 33; A. Sherikov's implementation.

Timed: ``setup`` copies and reserves the workspace; ``update`` copies P and q; ``solve`` copies P, since the library
overwrites it, factorises and iterates. There is no warm start, only the workspace is used again.
"""

import numpy as np
import pyqpmad
from qpsolvers import Problem, Solution

from solvers import backend as known
from solvers.backend import LibrarySolver
from solvers.protocol import Vector
from solvers.rows import Program


class Pyqpmad(LibrarySolver):
    """The library's ``Solver``."""

    name = "pyqpmad"
    library = known.PYQPMAD

    def setup(self, problem: Problem) -> None:  # noqa: D102
        self.program = p = Program(problem)
        rows = p.l.size - p.d
        self._parameters = pyqpmad.SolverParameters()
        self.choose(self._parameters)
        self._solver = pyqpmad.Solver()
        self._solver.reserve(p.d, p.d, rows)
        self._x = np.zeros(p.d)
        self._work = np.empty((p.d, p.d))
        # The transpose of the symmetric work matrix is the Fortran order that the library wants.
        fixed = (p.l[p.bounds], p.u[p.bounds])
        general = (np.asfortranarray(p.R[p.general]), p.l[p.general], p.u[p.general]) if rows else (None, None, None)
        self._arguments = (self._x, self._work.T, p.q, *fixed, *general, self._parameters)

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        self._work[:] = self.program.P
        try:
            status = self._solver.solve(*self._arguments)
        except RuntimeError as error:  # how the library says infeasible, or P not positive definite
            self._found, self._status = False, str(error)
            return self.program.no_answer()
        self._found, self._status = status == pyqpmad.ReturnStatus.OK, status.name
        return self._x if self._found else self.program.no_answer()

    def solution(self) -> Solution:  # noqa: D102
        p = self.program
        w = np.zeros(p.l.size)
        iterations = None
        if self._found:
            dual = self._solver.get_inequality_dual()
            w[dual.indices] = np.where(dual.is_lower, -dual.dual, dual.dual)
            iterations = self._solver.get_num_iterations()
            # The library gives no multipliers of equalities; they are what stationarity leaves over.
            equal = p.l == p.u
            w[equal] = np.linalg.lstsq(p.R[equal].T, -(p.P @ self._x + p.q + p.R.T @ w), rcond=None)[0]
        return p.solution(self._x, w, self._found, status=self._status, reported_us=None, iterations=iterations)
