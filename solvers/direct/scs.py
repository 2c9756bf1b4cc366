"""SCS: operator splitting (Douglas-Rachford) on the homogeneous embedding, with Anderson acceleration.

    minimise ½ xᵀP x + cᵀx   subject to   R x + s = r,  s ∈ {0}ᵖ × ℝ₊ᵐ;   c = q

Source: B. O'Donoghue, "Operator splitting for a homogeneous embedding of the linear complementarity problem", SIAM
Journal on Optimization 31 (2021), pages 1999 to 2023.

Timed: ``setup`` scales and factorises; ``update`` passes q, or makes the library's object again for a new P, since
there is no other way; ``solve`` iterates. A warm solve starts from ``warm_start`` and the multipliers and slacks of the
last solved problem, a cold one from zero. The linear solver is the library's own QDLDL on every machine: by default it
is MKL if the wheel contains it.
"""

import numpy as np
import scs

from solvers.adapter import Cones, LibrarySolver, Matrix, Program, Report, Vector, csc_matrix


class Scs(LibrarySolver):
    """The library's ``SCS``."""

    form = Cones
    warm_startable = True

    def build(self, p: Program, rows: Cones) -> None:
        # The library needs a row: without constraints it gets 0ᵀx ≤ 1.
        R, r = (rows.R, rows.r) if rows.r.size else (np.zeros((1, p.d)), np.ones(1))
        self._constraints = {"A": csc_matrix(R), "b": r}
        self._cone = {"z": rows.equal, "l": r.size - rows.equal}
        self._dual: dict[str, Vector] = {}
        self.pass_data(p.P, p.q)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        if P is not None:
            self._solver = scs.SCS(
                {"P": self.program.triangle.matrix(P), "c": self.program.q, **self._constraints},
                self._cone,
                **{"verbose": False, **self.settings},
            )
        elif q is not None:
            self._solver.update(c=q)

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        start = {} if warm_start is None else {"x": warm_start, **self._dual}
        self._result = self._solver.solve(warm_start=warm_start is not None, **start)
        if self._result["info"]["status_val"] == scs.SOLVED:
            self._dual = {"y": self._result["y"], "s": self._result["s"]}
        return self._result["x"]

    def report(self) -> Report:
        r, info = self._result, self._result["info"]
        return Report(
            info["status_val"] == scs.SOLVED,
            r["y"][: self.rows.r.size],
            info["status"],
            info["iter"],
            1e3 * info["solve_time"],
        )
