"""quadprog's function for one program; see ``solvers/direct/quadprog.py``. Its rows are the finite bounds."""

from __future__ import annotations

import numpy as np
import quadprog

from bench.races.batch.contestant import Loop
from solvers import backend as known
from solvers.arrays import Matrix, Vector


class Quadprog(Loop):
    """``quadprog.solve_qp``."""

    algorithm, licence, distribution = known.QUADPROG.algorithm, known.QUADPROG.licence, known.QUADPROG.distribution

    def __init__(self, d: int, threads: int) -> None:
        super().__init__(d, threads)
        self._lower, self._both = np.eye(d), np.hstack([np.eye(d), -np.eye(d)])

    def one(self, P: Matrix, q: Vector, lb: Vector, ub: Vector) -> Vector:  # noqa: D102
        try:
            if np.isinf(ub).all() and np.isfinite(lb).all():
                return quadprog.solve_qp(P, -q, self._lower, lb)[0]
            bounds = np.concatenate([lb, -ub])
            finite = np.isfinite(bounds)
            return quadprog.solve_qp(P, -q, self._both[:, finite], bounds[finite])[0]
        except ValueError:  # how the library says that there is no answer
            return np.full(self.d, np.nan)
