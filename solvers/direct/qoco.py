"""QOCO: primal-dual interior point method on a sparse KKT system.

    minimise ½ xᵀP x + cᵀx   subject to   A x = b,  G x ≤ h;   c = q

Source: G. Chari, B. Açıkmeşe, "QOCO: a quadratic objective conic optimizer with custom solver generation", 2025.

Timed: ``setup`` allocates and orders; ``update`` hands over the upper triangle of P and q; ``solve`` iterates and
copies the results out of the library's memory. There is no warm start, and no test of infeasibility either: the library
ends in a numerical error.
"""

from __future__ import annotations

import numpy as np
import qoco
from qpsolvers import Problem, Solution
from scipy.sparse import csc_matrix

from solvers import backend as known
from solvers.backend import LibrarySolver
from solvers.protocol import Matrix, Vector
from solvers.rows import Cones, Program, Triangle


class Qoco(LibrarySolver):
    """The library's ``QOCO``."""

    name = "qoco"
    library = known.QOCO
    iteration_setting = "max_iters"

    def setup(self, problem: Problem) -> None:  # noqa: D102
        self.program = p = Program(problem)
        self._rows = rows = Cones(p)
        self._triangle = Triangle(p.d)
        n, m = rows.equal, rows.unequal
        self._solver = qoco.QOCO()
        A, G = (csc_matrix(R) if len(R) else None for R in (rows.R[:n], rows.R[n:]))
        self._solver.setup(p.d, m, n, self._triangle.matrix(p.P), p.q, A, rows.r[:n], G, rows.r[n:], m, 0, None,
                           **self.settings)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:  # noqa: D102
        self.program.take(P, q)
        if P is not None:
            self._solver.update_matrix_data(P=self._triangle.values(self.program.P))
        if q is not None:
            self._solver.update_vector_data(c=self.program.q)

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        self._result = self._solver.solve()
        x: Vector = self._result.x
        return x if self._result.status == "QOCO_SOLVED" else self.program.no_answer()

    def iterate(self) -> Vector | None:  # noqa: D102
        limit_met = self._result.status in ("QOCO_MAX_ITER", "QOCO_SOLVED_INACCURATE")
        return np.array(self._result.x) if limit_met else None

    def solution(self) -> Solution:  # noqa: D102
        r = self._result
        w = self._rows.spread(np.concatenate([r.y, r.z]))
        return self.program.solution(r.x, w, r.status == "QOCO_SOLVED", status=r.status,
                                     reported_us=1e6 * r.solve_time_sec, iterations=r.iters)
