"""CVXOPT: primal-dual interior point method (coneqp), its iterations in Python.

    minimise ½ xᵀP x + qᵀx   subject to   A x = b,  G x + s = h,  s ≥ 0

Source: L. Vandenberghe, "The CVXOPT linear and quadratic cone program solvers", 2010.

Timed: ``setup`` and ``update`` fill the library's own matrices; ``solve`` is its function, which has no object that
persists. There is no warm start that pays.
"""

import cvxopt
import cvxopt.solvers
import numpy as np

from solvers.adapter import Cones, LibrarySolver, Matrix, Program, Report, Vector


class Cvxopt(LibrarySolver):
    """The library's ``solvers.qp``."""

    form = Cones

    def build(self, p: Program, rows: Cones) -> None:
        n = rows.equal
        arrays = {"P": p.P, "q": p.q, "G": rows.R[n:], "h": rows.r[n:], "A": rows.R[:n], "b": rows.r[:n]}
        self._data = {key: cvxopt.matrix(array) for key, array in arrays.items() if array.size}

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        self._data |= {"P": cvxopt.matrix(self.program.P), "q": cvxopt.matrix(self.program.q)}

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        try:
            self._result = cvxopt.solvers.qp(**self._data, options={"show_progress": False, **self.settings})
        except (ValueError, ArithmeticError) as error:  # the rows or the KKT matrix are singular
            self._result = {"status": str(error), "x": np.full(self.program.d, np.nan), "y": (), "z": ()}
        return np.array(self._result["x"]).ravel()

    def report(self) -> Report:
        r = self._result
        w = np.concatenate([np.array(r[key]).ravel() for key in "yz"])
        return Report(r["status"] == "optimal", w, r["status"], r.get("iterations"))
