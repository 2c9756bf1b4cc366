"""The arrays of the recursive solver for compiled loops that take rows themselves, until those loops are in C as it is.

The solver that the registry knows is ``solvers.kernel.recursive_active_set``.
"""

from __future__ import annotations

import numpy as np
from qpsolvers import Problem

from solvers.kernels import box_data
from solvers.kernels import swept_gram as swept
from solvers.kernels.swept_refresh import begin, recover
from solvers.kernels.swept_rows import write_answer
from solvers.protocol import Matrix, Vector, dense, only_box


class RecursiveEngine:
    """What continuous learning steps through: arrays of :mod:`solvers.kernels.swept_gram`."""

    name = "recursive_active_set"

    def __init__(self, **settings: float) -> None:
        self.settings = settings

    def setup(self, problem: Problem) -> None:
        """Allocate, and find the optimum of the data so far.

        Raises
        ------
        Unsupported
            The problem has general rows.
        ValueError
            A setting is out of range, a number is NaN or infinite where it may not be, bounds cross, P is not symmetric or
            indefinite, or the problem is unbounded.
        """
        lb, ub = only_box(problem, self.name)
        forgetting = float(self.settings.get("forgetting", 1.0))
        weight = float(self.settings.get("weight", 1.0 - forgetting if forgetting < 1.0 else 1.0))
        proximal = float(self.settings.get("proximal", 1e-10))
        if not 0.0 < forgetting <= 1.0:
            raise ValueError(f"{self.name}: forgetting must be above 0 and at most 1, not {forgetting}")
        if not 0.0 < weight < np.inf:
            raise ValueError(f"{self.name}: weight must be positive, not {weight}")
        if not 0.0 <= proximal < np.inf:
            raise ValueError(f"{self.name}: proximal must not be negative, but it is {proximal}")
        d = lb.size
        cold, sides = box_data.allocate(d)
        self._accept(box_data.set_bounds(cold, sides, lb, ub))
        work, iwork, numbers = swept.allocate(d)
        numbers[swept.FORGETTING], numbers[swept.ROOT_GROWTH] = forgetting, forgetting**-0.5
        numbers[swept.ROW_WEIGHT], numbers[swept.PROXIMAL] = weight, proximal
        head = work.reshape(-1, iwork[swept.LEADING])
        head[swept.LB, :d], head[swept.UB, :d] = np.maximum(lb, -swept.NO_BOUND), np.minimum(ub, swept.NO_BOUND)
        P, q = dense(problem)
        self._accept(begin(work, iwork, numbers, cold, sides, P, q, 0.0, False))
        write_answer(work, iwork)
        self._P, self._q = P, q
        self._work, self._iwork, self._numbers = work, iwork, numbers
        self._cold = cold, sides, np.empty((d, d)), np.empty(d)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Start again from other data of the same size; data refused (ValueError, as in ``setup``) change nothing."""
        P = self._P if P is None else np.array(P, dtype=np.float64, order="C")
        q = self._q if q is None else np.array(q, dtype=np.float64)
        if P.shape != self._P.shape or q.shape != self._q.shape:
            raise ValueError(f"{self.name}: P {P.shape} and q {q.shape} are not of the size of the problem set up")
        cold, sides = self._cold[:2]
        self._accept(begin(self._work, self._iwork, self._numbers, cold, sides, P, q, 0.0, False))
        write_answer(self._work, self._iwork)
        self._P, self._q = P, q

    def recover(self) -> None:
        """Begin anew from the data so far, by the cold exact solver."""
        self._accept(recover(self._work, self._iwork, self._numbers, *self._cold))
        write_answer(self._work, self._iwork)

    def _accept(self, status: int) -> None:
        if status != box_data.OK:
            raise ValueError(f"{self.name}: {box_data.REASONS[status]}")
