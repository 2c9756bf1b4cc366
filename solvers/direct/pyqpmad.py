"""qpmad: the dual active set method of Goldfarb and Idnani in C++ (Eigen), simple bounds treated apart from rows.

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub,  l ≤ R x ≤ u

Source: D. Goldfarb and A. Idnani, "A numerically stable dual method for solving strictly convex quadratic programs",
Mathematical Programming 27 (1983), pages 1 to 33; A. Sherikov's implementation.

Timed: ``setup`` copies and reserves the workspace; ``update`` copies P and q; ``solve`` copies P, since the library
overwrites it, factorises and iterates. There is no warm start, only the workspace is used again.
"""

import numpy as np
import pyqpmad

from solvers.adapter import LibrarySolver, Program, Report, Stack, Vector


class Pyqpmad(LibrarySolver):
    """The library's ``Solver``."""

    def build(self, p: Program, rows: Stack) -> None:
        m = p.l.size - p.d
        parameters = self.apply_settings(pyqpmad.SolverParameters())
        self._solver = pyqpmad.Solver()
        self._solver.reserve(p.d, p.d, m)
        self._x, self._work = np.zeros(p.d), np.empty((p.d, p.d))
        # The transpose of the symmetric work matrix has the Fortran order that the library needs.
        general = (np.asfortranarray(p.R[p.general]), p.l[p.general], p.u[p.general]) if m else (None, None, None)
        self._arguments = (self._x, self._work.T, p.q, p.lb, p.ub, *general, parameters)

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._work[:] = self.program.P
        try:
            status = self._solver.solve(*self._arguments)
        except RuntimeError as error:  # the problem is infeasible, or P not positive definite
            self._status = str(error)
            return None
        self._status = status.name
        return self._x.view()

    def report(self) -> Report:
        p, w = self.program, np.zeros(self.rows.size)
        if self._status not in pyqpmad.ReturnStatus.__members__:
            return Report(False, w, self._status)
        dual = self._solver.get_inequality_dual()
        w[dual.indices] = np.where(dual.is_lower, -dual.dual, dual.dual)
        # The library gives no multipliers of equalities; they follow from stationarity.
        equal = p.l == p.u
        w[equal] = np.linalg.lstsq(p.R[equal].T, -(p.P @ self._x + p.q + p.R.T @ w), rcond=None)[0]
        return Report(self._status == "OK", w, self._status, self._solver.get_num_iterations())
