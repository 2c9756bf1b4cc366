"""MuJoCo's ``mju_boxQP``; see ``solvers/direct/mujoco.py``. Its limits cannot be set, so it is as exact as it is."""

from __future__ import annotations

import numpy as np
from mujoco import _functions

from bench.races.batch.contestant import Loop
from solvers.arrays import Matrix, Vector


class Mujoco(Loop):
    """The library's function, from zero each time."""

    algorithm, licence, distribution = "projected Newton", "Apache-2.0", "mujoco-core"

    def __init__(self, d: int, threads: int) -> None:
        super().__init__(d, threads)
        self._x, self._factor = np.zeros(d), np.zeros((d, d + 7))

    def one(self, P: Matrix, q: Vector, lb: Vector, ub: Vector) -> Vector:  # noqa: D102
        self._x[:] = 0.0
        free = _functions.mju_boxQP(self._x, self._factor, None, P, q, lb, ub)
        return self._x if free >= 0 else np.full(self.d, np.nan)
