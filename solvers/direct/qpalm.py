"""QPALM: proximal augmented Lagrangian method, each subproblem by a semi-smooth Newton method with exact line search.

    minimise ½ xᵀQ x + qᵀx   subject to   l ≤ R x ≤ u;   Q = P

Source: B. Hermans, A. Themelis, P. Patrinos, "QPALM: a proximal augmented Lagrangian method for nonconvex quadratic
programs", Mathematical Programming Computation 14 (2022), pages 497 to 541.

Timed: ``setup`` scales and factorises; ``update`` hands over the upper triangle of P and q; ``solve`` iterates in the
calling thread (the library's default is a second one that can be interrupted) and copies x out of its memory. A warm
solve starts from ``warm_start`` with multipliers of zero, a cold one from zero.
"""

import numpy as np
import qpalm
from qpsolvers import Problem, Solution
from scipy.sparse import csc_matrix

from solvers import backend as known
from solvers.backend import LibrarySolver
from solvers.direct._box import refuse_crossing
from solvers.protocol import Matrix, Vector
from solvers.rows import Intervals, Program, Triangle


class Qpalm(LibrarySolver):
    """The library's ``Solver``."""

    name = "qpalm"
    library = known.QPALM
    warm_startable = True
    iteration_setting = "max_iter"

    def setup(self, problem: Problem) -> None:  # noqa: D102
        self.program = p = Program(problem)
        refuse_crossing(p, self.name)
        self._rows = rows = Intervals(p)
        self._triangle = Triangle(p.d)
        self._R = csc_matrix(rows.R)
        data = qpalm.Data(p.d, rows.l.size)
        data.Q, data.q = self._triangle.matrix(p.P), p.q
        data.A, data.bmin, data.bmax = self._R, rows.l, rows.u
        settings = qpalm.Settings()
        self.choose(settings, verbose=False)
        self._solver = qpalm.Solver(data, settings)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:  # noqa: D102
        self.program.take(P, q)
        if P is not None:
            self._solver.update_Q_A(self._triangle.values(self.program.P), self._R.data)
        if q is not None:
            self._solver.update_q(self.program.q)

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        if warm_start is not None:
            self._solver.warm_start(np.ascontiguousarray(warm_start), None)
        self._solver.solve(asynchronous=False)
        self._found = self._solver.info.status == "solved"
        return self._solver.solution.x.copy() if self._found else self.program.no_answer()

    def iterate(self) -> Vector | None:  # noqa: D102
        limit_met = self._solver.info.status == "maximum iterations reached"
        return np.array(self._solver.solution.x) if limit_met else None

    def solution(self) -> Solution:  # noqa: D102
        s, info = self._solver.solution, self._solver.info
        return self.program.solution(
            s.x,
            self._rows.distribute(s.y),
            self._found,
            status=info.status,
            reported_us=1e6 * info.solve_time,
            iterations=info.iter,
        )
