"""PIQP: proximal interior point method, an infeasible Mehrotra predictor-corrector on a regularised dense KKT system.

    minimise ½ xᵀP x + cᵀx   subject to   A x = b,  G x ≤ h,  lb ≤ x ≤ ub;   c = q

Source: R. Schwan, Y. Jiang, D. Kuhn, C. N. Jones, "PIQP: a proximal interior-point quadratic programming solver", 62nd
IEEE Conference on Decision and Control (2023).

Timed: ``setup`` allocates and equilibrates; ``update`` hands over P and q and equilibrates again; ``solve`` iterates,
one factorisation a step, and copies x out of the library's memory. There is no warm start.
"""

import numpy as np
import piqp

from solvers.adapter import LibrarySolver, Matrix, Program, Report, Stack, Vector


class Piqp(LibrarySolver):
    """The library's ``DenseSolver``."""

    def build(self, p: Program, rows: Stack) -> None:
        self._solver = piqp.DenseSolver()
        self.apply_settings(self._solver.settings, compute_timings=True)
        self._A = np.asfortranarray(p.A) if len(p.A) else None
        inequalities = (np.asfortranarray(p.G), None, p.h) if len(p.G) else (None, None, None)
        self._solver.setup(p.P.T, p.q, self._A, p.b if len(p.A) else None, *inequalities, p.lb, p.ub)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        # P is symmetric, so its transpose is P in the Fortran order that the library needs. A is passed too: the
        # library equilibrates again for a new P without updating its product AᵀA, and then reports feasible problems as
        # infeasible.
        self._solver.update(c=q, **({} if P is None else {"P": P.T, "A": self._A}))

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._status = self._solver.solve()
        return self._solver.result.x.copy()

    def report(self) -> Report:
        r = self._solver.result
        w = np.concatenate([r.z_bu - r.z_bl, r.y, r.z_u])
        return Report(self._status == piqp.PIQP_SOLVED, w, self._status.name, r.info.iter, 1e6 * r.info.solve_time)
