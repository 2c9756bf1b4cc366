"""The exact optimum at every sample: a box QP whose data grow by one row at a time.

    P ← λ P + μ ξ ξᵀ,   q ← λ q + μ ξ x     at every row (ξ, x),   minimise ½ vᵀP v + qᵀv over lb ≤ v ≤ ub

The method stands in :mod:`solvers.kernels.swept_gram`: the Gram matrix swept on the free variables follows each row by a
matrix of rank one, and its last row is the answer. Timed in ``solve`` is what restores optimality after new data.

An answer is never refused where there is one. The factor is made anew by the refresh rule of
:mod:`solvers.kernels.swept_rows`, which bounds its drift. Where a pivot is singular, positive definiteness is lost or
the exchanges cycle, it is made anew at once; where that does not help, the cold exact solver is asked
(:func:`solvers.kernels.swept_refresh.recover`). An error is left for data that have no minimum.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from qpsolvers import Problem, Solution

from solvers.compiled import entry
from solvers.kernels import box_data
from solvers.kernels import swept_gram as swept
from solvers.kernels.swept_refresh import begin, recover
from solvers.kernels.swept_rows import LARGEST, take_row, take_rows, time_begin, write_answer
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
        Share of the diagonal of P, at most its mean, with which the answer is held where it was at the last refresh. With 0 it is
        held only while P is singular on the free variables.

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
        self._lb, self._ub, self._P, self._q, self._head = lb, ub, P, q, head
        self._work, self._iwork, self._numbers = work, iwork, numbers
        self._cold = cold, sides, np.empty((d, d)), np.empty(d)
        self._row, self._answer = np.zeros(d + 1), head[swept.ANSWER, :d]
        self._take_row = entry(take_row, work, iwork, numbers, self._row)

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

    def append(self, row: Vector, target: float) -> None:
        """Take the row ξ (d,) and the number x of one squared error ½ (vᵀξ + x)²; ValueError where one is not finite."""
        if np.shape(row) != self._q.shape:
            raise ValueError(f"{self.name}: a row has {self._q.size} numbers, not shape {np.shape(row)}")
        self._row[:-1], self._row[-1] = row, target
        status = self._take_row(self._work, self._iwork, self._numbers, self._row)
        if status == box_data.NOT_FINITE:
            raise ValueError(f"{self.name}: the row holds a number that is not finite, or above {LARGEST:g}")
        if status != box_data.OK:
            self.recover()

    def recover(self) -> None:
        """Begin anew from the data so far, by the cold exact solver."""
        self._accept(recover(self._work, self._iwork, self._numbers, *self._cold))
        write_answer(self._work, self._iwork)

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
        d = self._q.size
        if rows.ndim != 2 or rows.shape[1] != d + 1:
            raise ValueError(f"{self.name}: rows must have shape (N, {d + 1}), not {rows.shape}")
        usable = (np.abs(rows) < LARGEST).all(axis=1)
        if not usable.all():
            raise ValueError(f"{self.name}: row {int(np.argmin(usable))} holds a number that is not finite, or above {LARGEST:g}")
        answers, nanoseconds = np.empty((rows.shape[0], d)), np.empty(rows.shape[0], dtype=np.int64)
        self._accept(take_rows(self._work, self._iwork, self._numbers, *self._cold, rows.reshape(-1), answers.reshape(-1),
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
        cold, sides = self._cold[:2]
        self._accept(time_begin(self._work, self._iwork, self._numbers, cold, sides, self._P, self._q, nanoseconds))
        write_answer(self._work, self._iwork)
        return np.zeros(count, dtype=np.int64), nanoseconds

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the minimiser (d,) of the data so far; a start is of no use to a method that is always at the optimum."""
        return self._answer

    def problem(self) -> Problem:
        """Return the program whose optimum the answer is, proximal term included, in the user's variables."""
        d, vectors = self._lb.size, self._head
        decay = self._numbers[swept.ROW_WEIGHT] / self._numbers[swept.ROOT_WEIGHT]**2
        G = vectors[swept.VECTORS + self._iwork[swept.LEADING]:][:d + 1, :d + 1]
        G = (np.triu(G) + np.triu(G, 1).T) * decay
        rho = vectors[swept.RHO, :d] * decay
        origin, sign = vectors[swept.ORIGIN, :d], vectors[swept.SIGN, :d]
        P = sign[:, None] * G[:d, :d] * sign + np.diag(rho)
        q = sign * (G[:d, d] - rho * vectors[swept.CENTRE, :d])
        return Problem(P, q - P @ origin, lb=self._lb, ub=self._ub)

    def solution(self) -> Solution:
        """Return the answer; ``extras`` count exchanges, refreshes and cold starts."""
        return box_solution(self.problem(), self.solve().copy(), True, status="solved",
                            exchanges=int(self._iwork[swept.PIVOTS]), refreshes=int(self._iwork[swept.REFRESHES]),
                            cold_starts=int(self._iwork[swept.COLD_STARTS]))

    def _accept(self, status: int) -> None:
        if status != box_data.OK:
            raise ValueError(f"{self.name}: {box_data.REASONS[status]}")
