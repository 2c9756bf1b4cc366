"""quadprog: the dual active set method of Goldfarb and Idnani, the reference implementation of the field.

    minimise ½ xᵀP x − aᵀx   subject to   Cᵀx ≥ b, the first rows with equality;   a = −q

Source: D. Goldfarb and A. Idnani, "A numerically stable dual method for solving strictly convex quadratic programs",
Mathematical Programming 27 (1983), pages 1 to 33; B. Turlach's code.

Timed: ``setup`` stacks the rows; ``update`` copies P and q; ``solve`` is the library's one function, which copies,
factorises and iterates. There is no object to keep, no tolerance to set and no warm start.
"""

import numpy as np
import quadprog

from solvers.adapter import Cones, LibrarySolver, Matrix, Program, Report, Vector

NO_ANSWER = (
    "no solution",
    "not positive definite",
)  # messages of the library's ValueError on problems without an answer


class Quadprog(LibrarySolver):
    """The library's function ``solve_qp``."""

    form = Cones

    def build(self, p: Program, rows: Cones) -> None:
        self._a = -p.q
        self._constraints = (np.ascontiguousarray(-rows.R.T), -rows.r, rows.equal) if rows.r.size else ()

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        np.negative(self.program.q, out=self._a)

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        try:
            self._answer = quadprog.solve_qp(self.program.P, self._a, *self._constraints)
        except ValueError as error:
            if not str(error).endswith(NO_ANSWER):
                raise
            self._answer = None, str(error)
        return self._answer[0]

    def report(self) -> Report:
        if self._answer[0] is None:
            return Report(False, np.zeros(0), self._answer[1])
        _, _, _, counts, lagrangian, _ = self._answer
        return Report(True, lagrangian[: self.rows.r.size], "solved", int(counts[0]))
