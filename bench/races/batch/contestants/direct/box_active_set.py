"""Our exact solver, called from Python for each program."""

from __future__ import annotations

import numpy as np

from bench.races.batch.contestant import Loop
from solvers.arrays import Matrix, Vector
from solvers.core import OK, block, face
from solvers.ours import Ours


class BoxActiveSet(Ours, Loop):
    """The same compiled functions as in the lane kernel, three calls a program."""

    algorithm = "primal-dual active set"

    def __init__(self, d: int, threads: int) -> None:
        super().__init__(d, threads)
        self._state = block(face.box_bytes(d))
        face.box_setup(self._state, np.zeros(d), np.zeros(d))
        at = face.box_places(self._state)["answer"]
        self._answer = self._state.view(np.float64)[at:at + d]

    def one(self, P: Matrix, q: Vector, lb: Vector, ub: Vector) -> Vector:  # noqa: D102
        status = face.box_setup(self._state, lb, ub) or face.box_take(self._state, P, q) or face.box_solve(self._state, 0)
        return self._answer if status == OK else np.full(self.d, np.nan)
