"""qpOASES: parametric active set method, reached through CasADi.

    minimise ½ xᵀh x + gᵀx   subject to   lba ≤ a x ≤ uba,  lbx ≤ x ≤ ubx;   h = P, g = q, a = (A; G)

Sources: H. J. Ferreau, C. Kirches, A. Potschka, H. G. Bock, M. Diehl, "qpOASES: a parametric active-set algorithm for
quadratic programming", Mathematical Programming Computation 6 (2014), pages 327 to 363; J. A. E. Andersson, J. Gillis,
G. Horn, J. B. Rawlings, M. Diehl, "CasADi: a software framework for nonlinear optimization and optimal control",
Mathematical Programming Computation 11 (2019), pages 1 to 36.

Timed: ``setup`` makes the function; ``update`` copies P and q into arrays that the function reads in place through its
buffer; ``solve`` is one call without conversions.
"""

import contextlib
import io
from typing import Any

import casadi
import numpy as np

from solvers.adapter import LibrarySolver, Program, Report, Stack, Vector


class CasadiQpoases(LibrarySolver):
    """``casadi.conic`` with the plugin qpoases, of dense h and a."""

    def build(self, p: Program, rows: Stack) -> None:
        # Without rows, the library ignores the bounds of a single variable: then it gets the row 0 ≤ 0ᵀx ≤ 1.
        R, below, above = (
            (p.R[p.general], p.l[p.general], p.u[p.general])
            if p.d > 1 or p.u.size > 1
            else (np.zeros((1, p.d)), np.zeros(1), np.ones(1))
        )
        self._x, self._w = np.zeros(p.d), np.zeros(rows.size)
        shapes = {"h": casadi.Sparsity.dense(p.d, p.d), "a": casadi.Sparsity.dense(*R.shape)}
        with contextlib.redirect_stdout(io.StringIO()):  # a banner for every function, whatever its print level
            self._function = casadi.conic(
                "qp", "qpoases", shapes, {"error_on_fail": False, "printLevel": "none", **self.settings}
            )
            self._buffer: Any
            self._buffer, self._call = self._function.buffer()
        # The buffer keeps addresses without references, and reads matrices by columns.
        self._arrays = {
            "h": p.P.reshape(-1),
            "g": p.q,
            "a": R.ravel(order="F"),
            "lba": below,
            "uba": above,
            "lbx": p.lb,
            "ubx": p.ub,
        }
        for key, array in self._arrays.items():
            if array.size:
                self._buffer.set_arg(self._function.index_in(key), array.data)
        for key, array in {"x": self._x, "lam_x": self._w[p.bounds], "lam_a": self._w[p.general]}.items():
            if array.size:
                self._buffer.set_res(self._function.index_out(key), array.data)

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._call()
        return self._x

    def report(self) -> Report:
        stats = self._buffer.stats()
        seconds = stats.get("t_wall_solver")
        status = f"{stats['unified_return_status']}: {stats['return_status']}"
        return Report(stats["success"], self._w, status, stats["iter_count"], 1e6 * seconds if seconds else None)
