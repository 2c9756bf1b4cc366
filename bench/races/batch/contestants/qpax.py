"""qpax, mapped over the batch by ``jax.vmap`` and compiled for its size, which is not timed; see
``solvers/direct/qpax.py``."""

import jax
import jax.numpy as jnp
import numpy as np
import qpax

from bench.races.batch.contestant import Contestant
from solvers import backend as known
from solvers.arrays import Matrix

jax.config.update("jax_enable_x64", True)


class Qpax(Contestant):
    """``qpax.solve_qp`` with its implicit method at its smallest tolerance; infinite bounds become inactive rows."""

    algorithm, licence, distribution = known.QPAX.algorithm, known.QPAX.licence, known.QPAX.distribution
    compiles = True

    def __init__(self, d: int, threads: int) -> None:
        super().__init__(d, threads)
        self._lower, self._both = (
            jax.jit(jax.vmap(self._solver(np.array(rows)))) for rows in (-np.eye(d), [*-np.eye(d), *np.eye(d)])
        )

    def _solver(self, rows: Matrix):  # type: ignore[no-untyped-def]  # a function of JAX's arrays, which have no types here
        def one(P, q, h):  # type: ignore[no-untyped-def]
            return qpax.solve_qp(
                P,
                q,
                jnp.zeros((0, self.d)),
                jnp.zeros(0),
                jnp.asarray(rows),
                h,
                solver_tol=1e-15,
                max_iter=100,
                backend="i",
            )[0]

        return one

    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> Matrix:  # noqa: D102
        if np.isinf(ub).all() and np.isfinite(lb).all():
            return np.asarray(self._lower(P, q, -lb))
        return np.asarray(self._both(P, q, np.minimum(np.hstack([-lb, ub]), 1e9)))
