"""QOCO: primal-dual interior point method on a sparse KKT system.

    minimise ½ xᵀP x + cᵀx   subject to   A x = b,  G x ≤ h;   c = q

Source: G. Chari, B. Açıkmeşe, "QOCO: a quadratic objective conic optimizer with custom solver generation", 2025.

One tolerance bounds the gap, the residual of the gradient and that of the rows, though the last is in the unit of x and
the others are in those of the cost; asked for as little as the gap, rounding never lets the rows have it. So with our
settings it is 1e-9 and the cost is given in units of ``cost_unit``, the power of two of which 1e-9 is what the rung
asks of the gap; that rounds nothing.

Timed: ``setup`` allocates and orders; ``update`` hands over the upper triangle of P and q; ``solve`` iterates and
copies the results out of the library's memory. There is no warm start, and no test of infeasibility either: the library
ends in a numerical error.
"""

import math
from dataclasses import replace

import numpy as np
import qoco
from qpsolvers import Problem, Solution
from scipy.sparse import csc_matrix

from solvers import backend as known
from solvers.backend import LibrarySolver, absolute, nothing
from solvers.protocol import Matrix, Vector
from solvers.rows import Cones, Program, Triangle

ABSTOL = 1e-9


def cost_unit(c: float, k: float) -> float:
    """The power of two next to c · 10⁻ᵏ / ABSTOL."""
    return 2.0 ** round(math.log2(absolute(c, k) / ABSTOL))


class Qoco(LibrarySolver):
    """The library's ``QOCO``."""

    name = "qoco"
    library = replace(
        known.QOCO,
        tolerances={"abstol": lambda c, k: ABSTOL, "reltol": nothing, "cost_unit": cost_unit},
        rungs=(4, 6, 8, 10, 12, 13, 14, 15),
    )
    iteration_setting = "max_iters"

    def setup(self, problem: Problem) -> None:  # noqa: D102
        self.program = p = Program(problem)
        self._rows = rows = Cones(p)
        self._triangle = Triangle(p.d)
        n, m = rows.equal, rows.unequal
        self._solver = qoco.QOCO()
        A, G = (csc_matrix(R) if len(R) else None for R in (rows.R[:n], rows.R[n:]))
        settings = dict(self.settings)
        self._unit = unit = settings.pop("cost_unit", 1.0)
        self._solver.setup(
            p.d,
            m,
            n,
            self._triangle.matrix(p.P) / unit,
            p.q / unit,
            A,
            rows.r[:n],
            G,
            rows.r[n:],
            m,
            0,
            None,
            **settings,
        )

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:  # noqa: D102
        self.program.take(P, q)
        if P is not None:
            self._solver.update_matrix_data(P=self._triangle.values(self.program.P) / self._unit)
        if q is not None:
            self._solver.update_vector_data(c=self.program.q / self._unit)

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        self._result = self._solver.solve()
        x: Vector = self._result.x
        return x if self._result.status == "QOCO_SOLVED" else self.program.no_answer()

    def iterate(self) -> Vector | None:  # noqa: D102
        limit_met = self._result.status in ("QOCO_MAX_ITER", "QOCO_SOLVED_INACCURATE")
        return np.array(self._result.x) if limit_met else None

    def solution(self) -> Solution:  # noqa: D102
        r = self._result
        w = self._rows.distribute(self._unit * np.concatenate([r.y, r.z]))
        return self.program.solution(
            r.x, w, r.status == "QOCO_SOLVED", status=r.status, reported_us=1e6 * r.solve_time_sec, iterations=r.iters
        )
