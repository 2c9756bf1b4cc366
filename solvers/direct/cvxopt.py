"""CVXOPT: primal-dual interior point method (coneqp), its iterations in Python.

    minimise ½ xᵀP x + qᵀx   subject to   A x = b,  G x + s = h,  s ≥ 0

Source: L. Vandenberghe, "The CVXOPT linear and quadratic cone program solvers", 2010.

Timed: ``setup`` and ``update`` fill the library's own matrices; ``solve`` is its function, which has no object that
persists. There is no warm start that pays.
"""

import cvxopt
import cvxopt.solvers
import numpy as np

from solvers.adapter import Answer, Cones, LibrarySolver, Matrix, Program, Vector
from solvers.backend import CVXOPT


class Cvxopt(LibrarySolver):
    """The library's ``solvers.qp``."""

    name = "cvxopt"
    library = CVXOPT
    form = Cones

    def build(self, p: Program, rows: Cones) -> None:
        n = rows.equal
        blocks = {"P": p.P, "q": p.q, "G": rows.R[n:], "h": rows.r[n:], "A": rows.R[:n], "b": rows.r[:n]}
        self._data = {key: cvxopt.matrix(block) for key, block in blocks.items() if block.size}

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        p = self.program
        p.take(P, q)
        self._data |= {"P": cvxopt.matrix(p.P), "q": cvxopt.matrix(p.q)}

    def solve(self, warm_start: Vector | None = None) -> Vector:
        try:
            self._result = cvxopt.solvers.qp(**self._data, options={"show_progress": False, **self.settings})
        except ValueError as error:  # its way of saying that the rows or the KKT matrix are singular
            self._result = {"status": str(error), "x": (), "y": (), "z": ()}
        self.found = self._result["status"] == "optimal"
        return np.array(self._result["x"]).ravel() if self.found else self.program.no_answer()

    def answer(self) -> Answer:
        r = self._result
        x, y, z = (np.array(r[key]).ravel() for key in "xyz")
        return Answer(x, np.concatenate([y, z]), r["status"], r.get("iterations"))
