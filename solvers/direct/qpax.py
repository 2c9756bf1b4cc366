"""qpax: primal-dual interior point method, compiled by JAX in double precision.

    minimise ½ xᵀQ x + qᵀx   subject to   A x = b,  G x ≤ h;   Q = P

Source: K. Tracy, Z. Manchester, "On the differentiability of the primal-dual interior-point method", 2024.

Timed: ``setup`` compiles for the shapes; ``solve`` copies P and q to JAX, iterates, and copies x back. There is no warm
start. Importing this file switches JAX to 64 bits in the whole process. The library's explicit method, its default,
bounds slacks and multipliers from below by 1.5e-8, so complementarity cannot fall below 1.5e-8 times the multiplier;
the implicit one of our settings has no such bound.
"""

from functools import partial

import jax
import numpy as np
import qpax

from solvers.adapter import Cones, LibrarySolver, Program, Report, Vector
from solvers.backend import QPAX

jax.config.update("jax_enable_x64", True)


class Qpax(LibrarySolver):
    """The library's ``solve_qp``, compiled."""

    library = QPAX
    form = Cones

    def build(self, p: Program, rows: Cones) -> None:
        n = rows.equal
        self._constraints = [jax.numpy.asarray(part) for part in (rows.R[:n], rows.r[:n], rows.R[n:], rows.r[n:])]
        solve = jax.jit(partial(qpax.solve_qp, **self.settings))
        self._solve = solve.lower(p.P, p.q, *self._constraints).compile()

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._result = self._solve(self.program.P, self.program.q, *self._constraints)
        return np.asarray(self._result[0]) if self._result[4] else None

    def report(self) -> Report:
        x, _, z, y, _, iterations = self._result
        return Report(x, np.concatenate([y, z]), "converged" if self.found else "not converged", int(iterations))
