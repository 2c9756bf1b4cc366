"""OSQP: operator splitting (ADMM), every step one backward substitution with a factor that is kept.

    minimise ½ xᵀP x + qᵀx   subject to   l ≤ R x ≤ u

Source: B. Stellato, G. Banjac, P. Goulart, A. Bemporad, S. Boyd, "OSQP: an operator splitting solver for quadratic
programs", Mathematical Programming Computation 12 (2020), pages 637 to 672.

Timed: ``setup`` scales and factorises; ``update`` copies the upper triangle of P and q into the library and factorises
again; ``solve`` iterates. A cold solve starts from zero, a warm one from ``warm_start`` and the multipliers of the last
solve; the penalty ρ that a solve has adapted stays for the next, as the library means it.

The adaptation of ρ is counted in steps and not in seconds, so that a run can be repeated. Polishing, which solves the
equations of the rows that seem active, is off, as in the library, but for the last rungs: after a loose or warm solve
on badly scaled data it takes the wrong rows and spoils the answer.
"""

import numpy as np
import osqp
from qpsolvers import Problem, Solution
from scipy.sparse import csc_matrix

from solvers import backend as known
from solvers.backend import LibrarySolver
from solvers.direct._box import refuse_crossing
from solvers.protocol import Matrix, Vector
from solvers.rows import Intervals, Program, Triangle


class Osqp(LibrarySolver):
    """The library's ``OSQP``."""

    name = "osqp"
    library = known.OSQP
    warm_startable = True
    iteration_setting = "max_iter"

    def setup(self, problem: Problem) -> None:  # noqa: D102
        self.program = p = Program(problem)
        self._rows = Intervals(p)
        self._triangle = Triangle(p.d)
        refuse_crossing(p, self.name)
        self._zero = np.zeros(p.d), np.zeros(self._rows.l.size)
        self._solver = osqp.OSQP()
        self._solver.setup(
            self._triangle.matrix(p.P),
            p.q.copy(),
            csc_matrix(self._rows.R),
            self._rows.l,
            self._rows.u,
            **{"verbose": False, **self.settings},
        )

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:  # noqa: D102
        p = self.program
        p.take(P, q)
        new = {} if P is None else {"Px": self._triangle.values(p.P)}
        if q is not None:
            new["q"] = p.q
        self._solver.update(**new)

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        if warm_start is None:
            self._solver.warm_start(*self._zero)
        else:
            self._solver.warm_start(x=np.ascontiguousarray(warm_start))
        self._result = self._solver.solve(raise_error=False)
        # On failure x holds a finite number, the bits of a NaN read as an integer: the status comes first.
        self._found = self._result.info.status_val == osqp.SolverStatus.OSQP_SOLVED
        x: Vector = self._result.x
        return x if self._found else self.program.no_answer()

    def iterate(self) -> Vector | None:  # noqa: D102
        limit_met = self._result.info.status_val in (
            osqp.SolverStatus.OSQP_MAX_ITER_REACHED,
            osqp.SolverStatus.OSQP_SOLVED_INACCURATE,
        )
        return np.array(self._result.x) if limit_met else None

    def solution(self) -> Solution:  # noqa: D102
        r = self._result
        return self.program.solution(
            r.x,
            self._rows.distribute(r.y),
            self._found,
            status=r.info.status,
            reported_us=1e6 * r.info.solve_time,
            iterations=r.info.iter,
        )
