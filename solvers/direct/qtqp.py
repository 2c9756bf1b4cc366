"""QTQP: primal-dual interior point method on the homogeneous embedding, in Python.

    minimise ½ xᵀp x + cᵀx   subject to   a x + s = b,  s ∈ {0}ᶻ × ℝ₊ᵐ;   p = P, c = q

Source: B. O'Donoghue, the package qtqp.

Timed: ``setup`` and ``update`` make the library's object anew, which has no other way to take data; ``solve``
equilibrates and iterates. There is no warm start from x alone. The linear solver is SciPy's dense one on every machine:
left alone, the library takes the first that it finds, MKL's where its wheel brings it.
"""

import qtqp
from qpsolvers import Problem, Solution
from scipy.sparse import csc_matrix

from solvers import backend as known
from solvers.backend import LibrarySolver
from solvers.protocol import Matrix, Unsupported, Vector
from solvers.rows import Cones, Program


class Qtqp(LibrarySolver):
    """The library's ``QTQP``."""

    name = "qtqp"
    library = known.QTQP

    def setup(self, problem: Problem) -> None:  # noqa: D102
        self.program = p = Program(problem)
        self._rows = rows = Cones(p)
        if not rows.unequal:
            raise Unsupported("qtqp needs at least one inequality or bound, and the problem has none")
        self._a = csc_matrix(rows.R)
        self.update()

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:  # noqa: D102
        p = self.program
        p.take(P, q)
        self._solver = qtqp.QTQP(p=csc_matrix(p.P), c=p.q, a=self._a, b=self._rows.r, z=self._rows.equal)

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        linear = {"linear_solver": qtqp.LinearSolver.SCIPY_DENSE}
        self._result = self._solver.solve(verbose=False, **{**linear, **self.settings})
        self._found = self._result.status is qtqp.SolutionStatus.SOLVED
        x: Vector = self._result.x
        return x if self._found else self.program.no_answer()

    def solution(self) -> Solution:  # noqa: D102
        r = self._result
        return self.program.solution(
            r.x,
            self._rows.distribute(r.y),
            self._found,
            status=r.status.value,
            reported_us=None,
            iterations=r.iterations,
        )
