"""QOCO: primal-dual interior point method on a sparse KKT system.

    minimise ½ xᵀP x + cᵀx   subject to   A x = b,  G x ≤ h;   c = q

Source: G. Chari, B. Açıkmeşe, "QOCO: a quadratic objective conic optimizer with custom solver generation", 2025.

One tolerance bounds the gap, the residual of the gradient and that of the rows, though the last has the unit of x and
the others have those of the cost; rounding keeps the rows from meeting a tolerance as small as that on the gap. So with
our settings the tolerance is 1e-9 and the cost is divided by ``cost_unit``, a power of two (which rounds nothing), so
that 1e-9 of it is the gap of the rung.

Timed: ``setup`` allocates and orders; ``update`` hands over the upper triangle of P and q; ``solve`` iterates and
copies the results out of the library's memory. There is no warm start and no test of infeasibility: the library ends in
a numerical error.
"""

import numpy as np
import qoco

from solvers.adapter import Cones, LibrarySolver, Matrix, Program, Report, Vector, csc_matrix


class Qoco(LibrarySolver):
    """The library's ``QOCO``."""

    form = Cones

    def build(self, p: Program, rows: Cones) -> None:
        n, m = rows.equal, rows.unequal
        A, G = (csc_matrix(R) if len(R) else None for R in (rows.R[:n], rows.R[n:]))
        settings = dict(self.settings)
        self._unit = unit = settings.pop("cost_unit", 1.0)
        self._solver = qoco.QOCO()
        P = p.triangle.matrix(p.P) / unit
        self._solver.setup(p.d, m, n, P, p.q / unit, A, rows.r[:n], G, rows.r[n:], m, 0, None, **settings)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        if P is not None:
            self._solver.update_matrix_data(P=self.program.triangle.values(P) / self._unit)
        if q is not None:
            self._solver.update_vector_data(c=q / self._unit)

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._result = self._solver.solve()
        return self._result.x

    def report(self) -> Report:
        r = self._result
        w = self._unit * np.concatenate([r.y, r.z])
        return Report(r.status == "QOCO_SOLVED", w, r.status, r.iters, 1e6 * r.solve_time_sec)
