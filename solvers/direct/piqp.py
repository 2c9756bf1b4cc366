"""PIQP: proximal interior point method, an infeasible Mehrotra predictor-corrector on a regularised dense KKT system.

    minimise ½ xᵀP x + cᵀx   subject to   A x = b,  G x ≤ h,  lb ≤ x ≤ ub;   c = q

Source: R. Schwan, Y. Jiang, D. Kuhn, C. N. Jones, "PIQP: a proximal interior-point quadratic programming solver", 62nd
IEEE Conference on Decision and Control (2023).

Timed: ``setup`` allocates and equilibrates; ``update`` hands over P and q and equilibrates again; ``solve`` iterates,
one factorisation a step, and copies x out of the library's memory. There is no warm start.
"""

import numpy as np
import piqp
from qpsolvers import Problem, Solution

from solvers import backend as known
from solvers.backend import LibrarySolver
from solvers.protocol import Matrix, Vector
from solvers.rows import Program


class Piqp(LibrarySolver):
    """The library's ``DenseSolver``."""

    name = "piqp"
    library = known.PIQP
    iteration_setting = "max_iter"

    def setup(self, problem: Problem) -> None:  # noqa: D102
        self.program = p = Program(problem)
        self._solver = piqp.DenseSolver()
        self.choose(self._solver.settings, compute_timings=True)
        A, G = np.asfortranarray(p.R[p.equalities]), np.asfortranarray(p.R[p.inequalities])
        self._A = A if len(A) else None
        equalities = (A, p.u[p.equalities]) if len(A) else (None, None)
        inequalities = (G, None, p.u[p.inequalities]) if len(G) else (None, None, None)
        self._solver.setup(p.P.T, p.q, *equalities, *inequalities, p.l[p.bounds], p.u[p.bounds])

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:  # noqa: D102
        p = self.program
        p.take(P, q)
        # P is symmetric, so its transpose is P in the Fortran order that the library wants. A goes with it: a new P is
        # equilibrated anew, which the library's product AᵀA misses, and then feasible problems are called infeasible.
        A = None if P is None else self._A
        self._solver.update(P=None if P is None else p.P.T, c=None if q is None else p.q, A=A)

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        self._status = self._solver.solve()
        self._found = self._status == piqp.PIQP_SOLVED
        return self._solver.result.x.copy() if self._found else self.program.no_answer()

    def iterate(self) -> Vector | None:  # noqa: D102
        return np.array(self._solver.result.x) if self._status == piqp.PIQP_MAX_ITER_REACHED else None

    def solution(self) -> Solution:  # noqa: D102
        r = self._solver.result
        w = np.concatenate([r.z_bu - r.z_bl, r.y, r.z_u])
        return self.program.solution(
            r.x, w, self._found, status=self._status.name, reported_us=1e6 * r.info.solve_time, iterations=r.info.iter
        )
