"""QPALM: proximal augmented Lagrangian method, each subproblem by a semi-smooth Newton method with exact line search.

    minimise ½ xᵀQ x + qᵀx   subject to   l ≤ R x ≤ u;   Q = P

Source: B. Hermans, A. Themelis, P. Patrinos, "QPALM: a proximal augmented Lagrangian method for nonconvex quadratic
programs", Mathematical Programming Computation 14 (2022), pages 497 to 541.

Timed: ``setup`` scales and factorises; ``update`` hands over the upper triangle of P and q; ``solve`` iterates in the
calling thread (the library's default is a second one that can be interrupted) and copies x out of its memory. A warm
solve starts from ``warm_start`` with multipliers of zero, a cold one from zero.
"""

import qpalm

from solvers.adapter import Intervals, LibrarySolver, Matrix, Program, Report, Vector, csc_matrix


class Qpalm(LibrarySolver):
    """The library's ``Solver``."""

    form = Intervals
    warm_startable = True

    def build(self, p: Program, rows: Intervals) -> None:
        self._R = csc_matrix(rows.R)
        data = qpalm.Data(p.d, rows.l.size)
        data.Q, data.q = p.triangle.matrix(p.P), p.q
        data.A, data.bmin, data.bmax = self._R, rows.l, rows.u
        self._solver = qpalm.Solver(data, self.apply_settings(qpalm.Settings(), verbose=False))

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        if P is not None:
            self._solver.update_Q_A(self.program.triangle.values(P), self._R.data)
        if q is not None:
            self._solver.update_q(q)

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        if warm_start is not None:
            self._solver.warm_start(warm_start, None)
        self._solver.solve(asynchronous=False)
        return self._solver.solution.x.copy()

    def report(self) -> Report:
        info = self._solver.info
        return Report(info.status == "solved", self._solver.solution.y, info.status, info.iter, 1e6 * info.solve_time)
