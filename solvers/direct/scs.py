"""SCS: operator splitting (Douglas-Rachford) on the homogeneous embedding, with Anderson acceleration.

    minimise ½ xᵀP x + cᵀx   subject to   R x + s = r,  s ∈ {0}ᵖ × ℝ₊ᵐ;   c = q

Source: B. O'Donoghue, "Operator splitting for a homogeneous embedding of the linear complementarity problem", SIAM
Journal on Optimization 31 (2021), pages 1999 to 2023.

Timed: ``setup`` scales and factorises; ``update`` hands over q, or builds the library's object anew where P is new, for
which it has no other way; ``solve`` iterates. A warm solve starts from ``warm_start`` and the multipliers and slacks of
the last solved problem, a cold one from zero. The linear solver is the library's own QDLDL on every machine: left
alone, it takes MKL where the wheel brings it.
"""

import numpy as np
import scs
from qpsolvers import Problem, Solution
from scipy.sparse import csc_matrix

from solvers import backend as known
from solvers.backend import LibrarySolver
from solvers.protocol import Matrix, Vector
from solvers.rows import Cones, Program, Triangle


class Scs(LibrarySolver):
    """The library's ``SCS``."""

    name = "scs"
    library = known.SCS
    warm_startable = True
    iteration_setting = "max_iters"

    def setup(self, problem: Problem) -> None:  # noqa: D102
        self.program = p = Program(problem)
        self._rows = rows = Cones(p)
        self._triangle = Triangle(p.d)
        # The library wants a row: without constraints it gets 0ᵀx ≤ 1.
        some = rows.r.size > 0
        self._constraints = {"A": csc_matrix(rows.R if some else (1, p.d)), "b": rows.r if some else np.ones(1)}
        self._cone = {"z": rows.equal, "l": rows.unequal if some else 1}
        self._dual: dict[str, Vector] = {}
        self._build()

    def _build(self) -> None:
        p = self.program
        self._solver = scs.SCS(
            {"P": self._triangle.matrix(p.P), "c": p.q, **self._constraints},
            self._cone,
            **{"verbose": False, "linear_solver": "qdldl", **self.settings},
        )

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:  # noqa: D102
        self.program.take(P, q)
        if P is not None:
            self._build()
        elif q is not None:
            self._solver.update(c=self.program.q)

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        if warm_start is None:
            self._result = self._solver.solve(warm_start=False)
        else:
            self._result = self._solver.solve(warm_start=True, x=np.ascontiguousarray(warm_start), **self._dual)
        self._found = self._result["info"]["status_val"] == scs.SOLVED
        if not self._found:
            return self.program.no_answer()
        self._dual = {"y": self._result["y"], "s": self._result["s"]}
        x: Vector = self._result["x"]
        return x

    def iterate(self) -> Vector | None:  # noqa: D102
        limit_met = self._result["info"]["status_val"] == scs.SOLVED_INACCURATE
        return np.array(self._result["x"]) if limit_met else None

    def solution(self) -> Solution:  # noqa: D102
        r, info = self._result, self._result["info"]
        w = self._rows.distribute(r["y"][: self._rows.r.size])
        return self.program.solution(
            r["x"], w, self._found, status=info["status"], reported_us=1e3 * info["solve_time"], iterations=info["iter"]
        )
