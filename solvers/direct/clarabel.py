"""Clarabel: interior point method on the homogeneous embedding, quadratic costs kept as they are, sparse LDLᵀ.

    minimise ½ xᵀP x + qᵀx   subject to   R x + s = r,  s ∈ {0}ᵖ × ℝ₊ᵐ

Source: P. J. Goulart and Y. Chen, "Clarabel: an interior-point solver for conic programs with quadratic objectives",
arXiv 2405.12762 (2024).

Timed: ``setup`` equilibrates and orders the KKT system; ``update`` copies the upper triangle of P and q into the
library; ``solve`` iterates, one factorisation a step, and makes an array of the library's list. There is no warm start.
The time that the library reports includes its set-up. Presolve is off in every tier, since with it the library refuses
new data.
"""

import clarabel
import numpy as np

from solvers.adapter import Cones, LibrarySolver, Matrix, Program, Report, Vector, csc_matrix


class Clarabel(LibrarySolver):
    """The library's ``DefaultSolver``."""

    form = Cones

    def build(self, p: Program, rows: Cones) -> None:
        settings = self.apply_settings(clarabel.DefaultSettings(), verbose=False, presolve_enable=False)
        cones = [clarabel.ZeroConeT(rows.equal), clarabel.NonnegativeConeT(rows.unequal)]
        # The library reads the upper triangle; with a lower one it silently gives wrong answers.
        P = p.triangle.matrix(p.P)
        self._solver = clarabel.DefaultSolver(P, p.q, csc_matrix(rows.R), rows.r, cones, settings)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        data = {"P": None if P is None else self.program.triangle.values(P), "q": q}
        self._solver.update(**{name: new for name, new in data.items() if new is not None})

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._answer = self._solver.solve()
        return np.array(self._answer.x)

    def report(self) -> Report:
        a = self._answer
        return Report(
            a.status == clarabel.SolverStatus.Solved, np.array(a.z), str(a.status), a.iterations, 1e6 * a.solve_time
        )
