"""HiGHS: primal active set method of its quadratic solver, P regularised.

    minimise ½ xᵀ(P + δI)x + qᵀx   subject to   lb ≤ x ≤ ub,  l ≤ R x ≤ u

Source: Q. Huangfu and J. A. J. Hall, "Parallelizing the dual revised simplex method", Mathematical Programming
Computation 10 (2018), pages 119 to 142, for HiGHS; M. Feldmeier's quadratic solver in it.

Timed: ``setup`` passes the model; ``update`` passes the triangle of P and q; ``solve`` runs, always from the start,
since the quadratic solver takes no starting point, and makes an array of the library's answer.

The regularisation δ, 1e-7 by default, is never removed and changes the answer: the rungs decrease it, but none sets it
to 0, with which the library can hang. Some answers with the status optimal still have errors of 1e-4, and some solves
end in "Solve error", the library's own check of its answer. ``time_limit`` is that of a single solve in seconds: the
library's own limit applies to the total time of all solves of its object.
"""

import highspy
import numpy as np

from solvers.adapter import LibrarySolver, Matrix, Program, Report, Stack, Triangle, Vector, csc_matrix

INF = np.full(1, np.inf)


class Highspy(LibrarySolver):
    """The library's ``Highs``."""

    def build(self, p: Program, rows: Stack) -> None:
        self._triangle = Triangle(p.d, upper=False)
        self._columns = np.arange(p.d, dtype=np.int32)
        self._highs = highspy.Highs()
        options = {"output_flag": False, "threads": 1, **self.settings}
        self._time_limit_s: float = options.pop("time_limit", 5.0)
        for option, value in options.items():
            self._check(self._highs.setOptionValue(option, value), f"take the option {option} = {value!r}")
        # The quadratic solver ends in "Solve error" without rows.
        sides = (p.R[p.general], p.l[p.general], p.u[p.general]) if p.u.size > p.d else (np.zeros((1, p.d)), -INF, INF)
        R, (below, above) = csc_matrix(sides[0]), sides[1:]
        columns, rowwise = (p.q, p.lb, p.ub), (below, above, R.indptr, R.indices, R.data)
        sizes = p.d, R.shape[0], R.nnz, highspy.MatrixFormat.kColwise.value, highspy.ObjSense.kMinimize.value, 0.0
        status = self._highs.passModel(*sizes, *columns, *rowwise, np.zeros(p.d, dtype=np.int32))
        self._check(status, "take the problem")
        self.pass_data(p.P, None)

    def _check(self, status: highspy.HighsStatus, action: str) -> None:
        if status == highspy.HighsStatus.kError:
            raise ValueError(f"highspy does not {action}")

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        d, t, form = self.program.d, self._triangle, highspy.HessianFormat.kTriangular.value
        if P is not None:
            self._check(self._highs.passHessian(d, t.indices.size, form, t.indptr, t.indices, t.values(P)), "take P")
        if q is not None:
            self._highs.changeColsCost(d, self._columns, q)

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._begin_s = self._highs.getRunTime()
        self._highs.setOptionValue("time_limit", self._begin_s + self._time_limit_s)
        self._highs.run()
        answer = self._highs.getSolution()
        return np.array(answer.col_value) if answer.value_valid else None

    def report(self) -> Report:
        highs, answer, p = self._highs, self._highs.getSolution(), self.program
        w = -np.concatenate([answer.col_dual, answer.row_dual[: p.u.size - p.d]])
        status, optimal = highs.getModelStatus(), highspy.HighsModelStatus.kOptimal
        return Report(
            status == optimal,
            w,
            highs.modelStatusToString(status),
            highs.getInfo().qp_iteration_count,
            1e6 * (highs.getRunTime() - self._begin_s),
        )
