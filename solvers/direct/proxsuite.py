"""ProxQP: proximal augmented Lagrangian method, each subproblem by a semi-smooth Newton method on a dense LDLᵀ.

    minimise ½ xᵀP x + qᵀx   subject to   A x = b,  l ≤ C x ≤ u

Source: A. Bambade, S. El-Kazdadi, A. Taylor, J. Carpentier, "PROX-QP: yet another quadratic programming solver for
robotics and beyond", Robotics: Science and Systems 18 (2022).

Timed: ``setup`` allocates, equilibrates and factorises; ``update`` hands over P and q, scaled with the equilibration of
the set-up; ``solve`` iterates and copies x out of the library's memory. A cold solve starts from the equality
constrained minimiser, a warm one from ``warm_start`` and the multipliers of the last solve. Cold solves repeat in
value, not in bits. NaN in the data hangs the library.

Three faults of release 0.8.0 are avoided. A solve without an update since the last solve can end in NaN after 15
million steps, so it is preceded by an update with the same q. Bounds are rows, since with the library's own box this
always happens, it takes no initial multipliers, and it was not faster. An update resets the multipliers, so they are
kept here.
"""

import numpy as np
from proxsuite import proxqp

from solvers.adapter import Intervals, LibrarySolver, Matrix, Program, Report, Vector


class Proxsuite(LibrarySolver):
    """The library's ``proxqp.dense.QP``, bounds among the rows."""

    form = Intervals
    warm_startable = True

    def build(self, p: Program, rows: Intervals) -> None:
        self._equal = equal = rows.l == rows.u
        self._qp = proxqp.dense.QP(p.d, int(equal.sum()), int((~equal).sum()))
        self.apply_settings(self._qp.settings, compute_timings=True)
        self._cold = self._qp.settings.initial_guess
        self._qp.init(p.P, p.q, rows.R[equal], rows.l[equal], rows.R[~equal], rows.l[~equal], rows.u[~equal])
        self._dual: tuple[Vector | None, Vector | None] = (None, None)
        self._is_fresh = True

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        self._qp.update(H=P, g=q)
        self._is_fresh = True

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        if not self._is_fresh:
            self._qp.update(g=self.program.q)
        if warm_start is None:
            self._qp.settings.initial_guess = self._cold  # a warm solve has changed it
            self._qp.solve()
        else:
            self._qp.solve(warm_start, *self._dual)
        self._is_fresh = False
        results = self._qp.results
        if results.info.status.name == "PROXQP_SOLVED":
            self._dual = results.y.copy(), results.z.copy()  # an update resets them
        return results.x.copy()

    def report(self) -> Report:
        results, info = self._qp.results, self._qp.results.info
        w = np.empty(self._equal.size)
        w[self._equal], w[~self._equal] = results.y, results.z
        return Report(info.status.name == "PROXQP_SOLVED", w, info.status.name, info.iter, info.solve_time)
