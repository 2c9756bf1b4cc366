"""DAQP's function for one program; see ``solvers/direct/daqp.py``."""

from __future__ import annotations

import daqp
import numpy as np

from bench.races.batch.contestant import Loop
from solvers import backend as known
from solvers.arrays import Matrix, Vector


class Daqp(Loop):
    """``daqp.solve``, as quick as its object that is kept."""

    algorithm, licence, distribution = known.DAQP.algorithm, known.DAQP.licence, known.DAQP.distribution

    def __init__(self, d: int, threads: int) -> None:
        super().__init__(d, threads)
        self._rows, self._sense = np.zeros((0, d)), np.zeros(d, np.intc)

    def one(self, P: Matrix, q: Vector, lb: Vector, ub: Vector) -> Vector:  # noqa: D102
        x, _, flag, _ = daqp.solve(P, q, self._rows, ub, lb, self._sense)
        return x if flag > 0 else np.full(self.d, np.nan)
