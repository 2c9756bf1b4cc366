"""qpmad's object, which is kept; see ``solvers/direct/pyqpmad.py``."""

from __future__ import annotations

import numpy as np
import pyqpmad

from bench.races.batch.contestant import Loop
from solvers import backend as known
from solvers.arrays import Matrix, Vector


class Pyqpmad(Loop):
    """``pyqpmad.Solver`` on a copy of P, which it overwrites."""

    algorithm, licence, distribution = known.PYQPMAD.algorithm, known.PYQPMAD.licence, known.PYQPMAD.distribution

    def __init__(self, d: int, threads: int) -> None:
        super().__init__(d, threads)
        self._solver, self._parameters = pyqpmad.Solver(), pyqpmad.SolverParameters()
        self._solver.reserve(d, d, 0)
        self._x, self._work = np.zeros(d), np.empty((d, d))

    def one(self, P: Matrix, q: Vector, lb: Vector, ub: Vector) -> Vector:  # noqa: D102
        self._work[:] = P
        try:
            status = self._solver.solve(self._x, self._work.T, q, lb, ub, None, None, None, self._parameters)
        except RuntimeError:  # how the library says infeasible, or P not positive definite
            return np.full(self.d, np.nan)
        return self._x if status == pyqpmad.ReturnStatus.OK else np.full(self.d, np.nan)
