"""OSQP: operator splitting (ADMM), every step one backward substitution with a factor that is kept.

    minimise ½ xᵀP x + qᵀx   subject to   l ≤ R x ≤ u

Source: B. Stellato, G. Banjac, P. Goulart, A. Bemporad, S. Boyd, "OSQP: an operator splitting solver for quadratic
programs", Mathematical Programming Computation 12 (2020), pages 637 to 672.

Timed: ``setup`` scales and factorises; ``update`` copies the upper triangle of P and q into the library and factorises
again; ``solve`` iterates. A cold solve starts from zero, a warm one from ``warm_start`` and the multipliers of the last
solve; the adapted penalty ρ is kept for the next solve, as the library intends.

The interval of the adaptation of ρ is counted in steps, not in seconds, so that runs are repeatable. Polishing, which
solves the equations of the rows that seem active, is off, as by default, except for the last rung: after a loose or
warm solve on badly scaled data it selects wrong rows and spoils the answer.
"""

import numpy as np
import osqp

from solvers.adapter import Intervals, LibrarySolver, Matrix, Program, Report, Unsupported, Vector, csc_matrix

WITH_ANSWER = (
    osqp.SolverStatus.OSQP_SOLVED,
    osqp.SolverStatus.OSQP_SOLVED_INACCURATE,
    osqp.SolverStatus.OSQP_MAX_ITER_REACHED,
    osqp.SolverStatus.OSQP_TIME_LIMIT_REACHED,
)
"""With any other status the library returns no answer, but the bits of a NaN read as an integer."""


class Osqp(LibrarySolver):
    """The library's ``OSQP``."""

    form = Intervals
    warm_startable = True

    def build(self, p: Program, rows: Intervals) -> None:
        self._zero = np.zeros(p.d), np.zeros(rows.l.size)
        self._solver = osqp.OSQP()
        data = p.triangle.matrix(p.P), p.q.copy(), csc_matrix(rows.R), rows.l, rows.u
        try:
            self._solver.setup(*data, **{"verbose": False, **self.settings})
        except osqp.OSQPException as error:
            raise Unsupported(f"osqp refuses the problem with its error {error}; 4 is a P that is not convex") from None

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        self._solver.update(q=q, **({} if P is None else {"Px": self.program.triangle.values(P)}))

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._solver.warm_start(*(self._zero if warm_start is None else (warm_start,)))
        self._result = self._solver.solve(raise_error=False)
        return self._result.x if self._result.info.status_val in WITH_ANSWER else None

    def report(self) -> Report:
        r, info = self._result, self._result.info
        return Report(info.status_val == WITH_ANSWER[0], r.y, info.status, info.iter, 1e6 * info.solve_time)
