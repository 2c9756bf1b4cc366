"""QTQP: primal-dual interior point method on the homogeneous embedding, in Python.

    minimise ½ xᵀp x + cᵀx   subject to   a x + s = b,  s ∈ {0}ᶻ × ℝ₊ᵐ;   p = P, c = q

Source: B. O'Donoghue, the package qtqp.

Timed: ``setup`` and ``update`` make the library's object, which cannot take new data; ``solve`` equilibrates and
iterates. There is no warm start from x alone. The linear solver is SciPy's dense one on every machine: by default the
library uses the first that it finds, possibly MKL's.
"""

import qtqp

from solvers.adapter import Cones, LibrarySolver, Matrix, Program, Report, Unsupported, Vector, csc_matrix


class Qtqp(LibrarySolver):
    """The library's ``QTQP``."""

    form = Cones

    def build(self, p: Program, rows: Cones) -> None:
        if not rows.unequal:
            raise Unsupported("qtqp needs at least one inequality or bound, and the problem has none")
        self._a = csc_matrix(rows.R)
        self.pass_data(p.P, p.q)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        p, rows = self.program, self.rows
        self._solver = qtqp.QTQP(p=csc_matrix(p.P), c=p.q, a=self._a, b=rows.r, z=rows.equal)

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._result = self._solver.solve(
            verbose=False, **{"linear_solver": qtqp.LinearSolver.SCIPY_DENSE, **self.settings}
        )
        return self._result.x

    def report(self) -> Report:
        r = self._result
        return Report(r.status is qtqp.SolutionStatus.SOLVED, r.y, r.status.value, r.iterations)
