"""The exact optimum at every sample: a box QP whose data grow by one row at a time.

    P ← λ P + μ ξ ξᵀ,   q ← λ q + μ ξ x     at every row (ξ, x),   minimise ½ vᵀP v + qᵀv over lb ≤ v ≤ ub

The method is in :mod:`solvers.kernels.swept_gram`: the Gram matrix swept on the free variables follows each row by a matrix
of rank one, and its last row is the answer. Timed in ``solve`` is what restores optimality after new data.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from qpsolvers import Problem, Solution

from solvers.kernels import swept_gram as swept
from solvers.protocol import Lane, Matrix, Nanoseconds, Solver, Vector, box_solution, dense, only_box


class RecursiveActiveSet(Solver):
    """Exact box QP solver that takes rows.

    Settings
    --------
    forgetting : float, default 1
        λ in (0, 1] per row.
    weight : float, default 1 − λ, or 1 where nothing is forgotten
        μ, what a row weighs when it comes. With 1 − λ, P and q are weighted means.
    proximal : float, default 1e-10
        Share of the mean diagonal of P with which the answer is held where it was at the last refresh.

    Examples
    --------
    >>> import numpy as np, qpsolvers
    >>> s = RecursiveActiveSet(proximal=0.0)
    >>> s.setup(qpsolvers.Problem(np.eye(2), np.array([-1.0, 1.0]), lb=np.zeros(2)))
    >>> s.solve().tolist()
    [1.0, 0.0]
    >>> s.append(np.array([0.0, 1.0]), -3.0)  # one more squared error, ½ (v₂ − 3)²
    >>> s.solve().tolist()
    [1.0, 1.0]
    """

    name: ClassVar[str] = "recursive_active_set"
    lane: ClassVar[Lane] = Lane.KERNEL
    algorithm: ClassVar[str] = "principal pivoting on a recursively updated inverse"
    licence: ClassVar[str] = "MIT"
    distribution: ClassVar[str] = "piezobench"
    takes_rows: ClassVar[bool] = True

    def setup(self, problem: Problem) -> None:
        """Allocate, and find the optimum of the data so far.

        Raises
        ------
        Unsupported
            The problem has general rows.
        ValueError
            A number is NaN or infinite where it may not be, bounds cross, or P is singular and ``proximal`` zero.
        """
        lb, ub = only_box(problem, self.name)
        forgetting = float(self.settings.get("forgetting", 1.0))
        if not 0.0 < forgetting <= 1.0:
            raise ValueError(f"{self.name}: forgetting must be above 0 and at most 1, not {forgetting}")
        weight = float(self.settings.get("weight", 1.0 - forgetting if forgetting < 1.0 else 1.0))
        if np.any(np.isnan(lb)) or np.any(np.isnan(ub)) or np.any(lb > ub):
            raise ValueError(f"{self.name}: the bounds cross or are not numbers")
        self._lb, self._ub = lb, ub
        d = lb.size
        self._work, self._iwork, self._numbers = swept.allocate(d)
        self._numbers[swept.FORGETTING] = forgetting
        self._numbers[swept.ROOT_GROWTH] = forgetting**-0.5
        self._numbers[swept.ROW_WEIGHT] = weight
        self._numbers[swept.PROXIMAL] = float(self.settings.get("proximal", 1e-10))
        self._head = self._work.reshape(-1, self._iwork[swept.LEADING])
        self._head[swept.LB, :d] = np.maximum(lb, -swept.NO_BOUND)
        self._head[swept.UB, :d] = np.minimum(ub, swept.NO_BOUND)
        self._row, self._no_answers, self._no_times = np.zeros(d + 1), np.zeros(0), np.zeros(0, dtype=np.int64)
        P, q = dense(problem)
        self.update(P, q)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Start again from other data of the same size."""
        self._P: Matrix = self._P if P is None else np.array(P, dtype=np.float64, order="C")
        self._q: Vector = self._q if q is None else np.array(q, dtype=np.float64)
        if not (np.all(np.isfinite(self._P)) and np.all(np.isfinite(self._q))):
            raise ValueError(f"{self.name}: P or q holds a number that is not finite")
        self._check(swept.begin(self._work, self._iwork, self._numbers, self._P.reshape(-1), self._q))

    def append(self, row: Vector, target: float) -> None:
        """Take the row ξ (d,) and the number x of one squared error ½ (vᵀξ + x)²."""
        self._row[:-1], self._row[-1] = row, target
        if not np.all(np.isfinite(self._row)):
            raise ValueError(f"{self.name}: the row holds a number that is not finite")
        self._check(swept.take_rows(self._work, self._iwork, self._numbers, self._row, self._no_answers, self._no_times))

    def append_many(self, rows: Matrix) -> tuple[Matrix, Nanoseconds]:
        """Take rows (ξ, x), shape (N, d + 1), in one compiled call.

        Returns
        -------
        answers : array (N, d)
            The optimum after each row.
        nanoseconds : array (N,)
            What each took.
        """
        rows = np.ascontiguousarray(rows, dtype=np.float64)
        if not np.all(np.isfinite(rows)):
            raise ValueError(f"{self.name}: row {int(np.argmin(np.isfinite(rows).all(axis=1)))} holds a number that is not "
                             f"finite")
        answers, nanoseconds = np.empty((rows.shape[0], rows.shape[1] - 1)), np.empty(rows.shape[0], dtype=np.int64)
        self._check(swept.take_rows(self._work, self._iwork, self._numbers, rows.reshape(-1), answers.reshape(-1),
                                    nanoseconds))
        return answers, nanoseconds

    def time_rows(self, rows: Matrix, forgetting: float) -> tuple[Matrix, Nanoseconds]:
        """Take rows as :meth:`append_many` does; the data are this solver's own work and part of the time."""
        if forgetting != self._numbers[swept.FORGETTING]:
            raise ValueError(f"{self.name}: was set up with forgetting {self._numbers[swept.FORGETTING]}, not {forgetting}")
        return self.append_many(rows)

    def time_kernel(self, count: int, warm_start: Vector | None = None) -> tuple[Nanoseconds | None, Nanoseconds]:
        """Start anew from P and q, which includes finding the optimum, timed as solves; there is no update apart."""
        nanoseconds = np.empty(count, dtype=np.int64)
        self._check(swept.time_begin(self._work, self._iwork, self._numbers, self._P.reshape(-1), self._q, nanoseconds))
        return np.zeros(count, dtype=np.int64), nanoseconds

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the minimiser (d,) of the data so far; a start is of no use to a method that is always at the optimum."""
        return self._head[swept.ANSWER, :self._lb.size]

    def problem(self) -> Problem:
        """Return the program whose optimum the answer is, proximal term included, in the user's variables."""
        d, vectors = self._lb.size, self._head
        decay = self._numbers[swept.ROW_WEIGHT] / self._numbers[swept.ROOT_WEIGHT]**2
        G = vectors[swept.VECTORS + self._iwork[swept.LEADING]:][:d + 1, :d + 1]
        G = (np.triu(G) + np.triu(G, 1).T) * decay
        rho = self._numbers[swept.RHO] * decay
        origin, sign = vectors[swept.ORIGIN, :d], vectors[swept.SIGN, :d]
        P = sign[:, None] * G[:d, :d] * sign + rho * np.eye(d)
        q = sign * (G[:d, d] - rho * vectors[swept.CENTRE, :d])
        return Problem(P, q - P @ origin, lb=self._lb, ub=self._ub)

    def solution(self) -> Solution:
        """Return the answer; ``extras`` count exchanges and refreshes."""
        return box_solution(self.problem(), self.solve().copy(), True, status="solved",
                            exchanges=int(self._iwork[swept.PIVOTS]), refreshes=int(self._iwork[swept.REFRESHES]))

    def _check(self, status: int) -> None:
        if status == swept.SINGULAR:
            raise ValueError(f"{self.name}: P is singular on the free variables; a proximal term would decide")
        if status == swept.CYCLING:
            raise ValueError(f"{self.name}: the exchanges did not come to an end")
