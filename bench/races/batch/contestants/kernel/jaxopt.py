"""JAXopt's box-constrained OSQP mapped over the batch by ``jax.vmap``; compiling is not timed.

The package is no longer maintained, and qpsolvers imports it with all of JAX wherever it is installed, so the project does not ask for it:
``pip install jaxopt`` brings it into the race.
"""

from __future__ import annotations

import warnings

import jax
import jax.numpy as jnp
import numpy as np

from bench.races.batch.contestant import Contestant
from solvers.arrays import Matrix

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # that it is no longer maintained
    import jaxopt

jax.config.update("jax_enable_x64", True)


class Jaxopt(Contestant):
    """``jaxopt.BoxOSQP`` with a factorisation in place of conjugate gradients, of which fewer answers are right."""

    algorithm, licence, distribution = "operator splitting", "Apache-2.0", "jaxopt"
    compiles = True

    def __init__(self, d: int, threads: int) -> None:
        super().__init__(d, threads)
        solver = jaxopt.BoxOSQP(tol=1e-9, maxiter=4000, eq_qp_solve="lu")

        def one(P, q, lb, ub):  # type: ignore[no-untyped-def]  # of JAX's arrays, which have no types here
            return solver.run(params_obj=(P, q), params_eq=jnp.eye(d), params_ineq=(lb, ub)).params.primal[0]

        self._solve = jax.jit(jax.vmap(one))

    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> Matrix:  # noqa: D102
        return np.asarray(self._solve(P, q, lb, ub))
