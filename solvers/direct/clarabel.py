"""Clarabel: interior point method on the homogeneous embedding, quadratic costs kept as they are, sparse LDLᵀ.

    minimise ½ xᵀP x + qᵀx   subject to   R x + s = r,  s ∈ {0}ᵖ × ℝ₊ᵐ

Source: P. J. Goulart and Y. Chen, "Clarabel: an interior-point solver for conic programs with quadratic objectives",
arXiv 2405.12762 (2024).

Timed: ``setup`` equilibrates and orders the KKT system; ``update`` copies the upper triangle of P and q into the
library; ``solve`` iterates, one factorisation a step, and makes an array of the library's list. There is no warm start.
The time that the library reports counts its set-up too. Presolve is off in every tier, since the library refuses new
data when it is on.
"""

import clarabel
import numpy as np
from qpsolvers import Problem, Solution
from scipy.sparse import csc_matrix

from solvers import backend as known
from solvers.backend import LibrarySolver
from solvers.protocol import Matrix, Vector
from solvers.rows import Cones, Program, Triangle


class Clarabel(LibrarySolver):
    """The library's ``DefaultSolver``."""

    name = "clarabel"
    library = known.CLARABEL
    iteration_setting = "max_iter"

    def setup(self, problem: Problem) -> None:  # noqa: D102
        self.program = p = Program(problem)
        self._rows = rows = Cones(p)
        # The library reads the upper triangle; it takes a lower one without a word and answers wrong.
        self._triangle = Triangle(p.d, upper=True)
        settings = clarabel.DefaultSettings()
        self.choose(settings, verbose=False, presolve_enable=False)
        cones = [clarabel.ZeroConeT(rows.equal), clarabel.NonnegativeConeT(rows.unequal)]
        self._solver = clarabel.DefaultSolver(
            self._triangle.matrix(p.P), p.q, csc_matrix(rows.R), rows.r, cones, settings
        )

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:  # noqa: D102
        p = self.program
        p.take(P, q)
        new = {} if P is None else {"P": self._triangle.values(p.P)}
        if q is not None:
            new["q"] = p.q
        self._solver.update(**new)

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        self._answer = self._solver.solve()
        self._found = self._answer.status == clarabel.SolverStatus.Solved
        return np.array(self._answer.x) if self._found else self.program.no_answer()

    def iterate(self) -> Vector | None:  # noqa: D102
        limit_met = self._answer.status in (clarabel.SolverStatus.MaxIterations, clarabel.SolverStatus.AlmostSolved)
        return np.array(self._answer.x) if limit_met else None

    def solution(self) -> Solution:  # noqa: D102
        a = self._answer
        return self.program.solution(
            np.array(a.x),
            self._rows.distribute(np.array(a.z)),
            self._found,
            status=str(a.status),
            reported_us=1e6 * a.solve_time,
            iterations=a.iterations,
        )
