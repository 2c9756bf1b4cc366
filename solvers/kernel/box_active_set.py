"""Our exact solver: block principal pivoting with a dual active set behind it, for problems with bounds only.

    minimise ½ xᵀP x + qᵀx  subject to  lb ≤ x ≤ ub

The method, its rule for singular P and its sources stand in :mod:`solvers.kernels.box_pivoting`; here it is put
behind the four verbs. Timed in ``solve`` is one call of the compiled kernel on two work arrays that ``setup`` allocated.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from qpsolvers import Problem, Solution

from solvers.kernels import box_data
from solvers.kernels.box_data import DUAL_STEPS, OK, PROXIMAL_STEPS, REASONS, SINGULAR, STATE, SYSTEMS
from solvers.kernels.box_factor import ANSWER, Integers
from solvers.kernels.box_pivoting import solve_box
from solvers.kernels.forgetting import absorb
from solvers.kernels.vector import compiled, entry
from solvers.nanoclock import monotonic_ns
from solvers.protocol import Lane, Matrix, Nanoseconds, Solver, Vector, box_solution, dense, only_box


class BoxActiveSet(Solver):
    """Exact box QP solver, cold or warm; it has no tolerance, so every tier is the same.

    Settings
    --------
    warm : bool, default False
        Whether ``solve()`` starts from the last active set, so that its time depends on what was solved before. With False it
        starts from "all free" and the answer is a function of the data alone, to the last bit. ``solve(x)`` always
        starts from the active set of x.

    Examples
    --------
    >>> import numpy as np, qpsolvers
    >>> s = BoxActiveSet()
    >>> s.setup(qpsolvers.Problem(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([1.0, -4.0]), lb=np.zeros(2)))
    >>> s.solve().tolist()
    [0.0, 2.0]
    """

    name: ClassVar[str] = "box_active_set"
    lane: ClassVar[Lane] = Lane.KERNEL
    algorithm: ClassVar[str] = "primal-dual active set"
    licence: ClassVar[str] = "MIT"
    distribution: ClassVar[str] = "piezobench"
    warm_startable: ClassVar[bool] = True

    def setup(self, problem: Problem) -> None:
        """Allocate, scale and factorise.

        Raises
        ------
        Unsupported
            The problem has general rows.
        ValueError
            A number is NaN or infinite where it may not be, P is not symmetric or indefinite beyond rounding, or bounds cross.
        """
        lb, ub = only_box(problem, self.name)
        P, q = dense(problem)
        self._warm = bool(self.settings.get("warm", False))
        self._work, self._iwork = box_data.allocate(q.size)
        self._answer = self._work[ANSWER, :q.size]
        self._P, self._q, self._lb, self._ub = np.empty_like(P), np.empty_like(q), lb, ub
        self._status = OK
        self._solve_box = entry(solve_box, self._work, self._iwork, True)
        _accept(box_data.set_bounds(self._work, self._iwork, lb, ub))
        self.update(P, q)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Take new P or q; refused data (ValueError, as in ``setup``) leave the solver without a valid problem."""
        if P is not None:
            np.copyto(self._P, P)
            _accept(box_data.set_hessian(self._work, self._iwork, self._P))
        if q is not None:
            np.copyto(self._q, q)
            _accept(box_data.set_linear(self._work, self._iwork, self._q))

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the minimiser, shape (d,), a view that the next call overwrites.

        Raises
        ------
        ValueError
            The problem is unbounded below.
        """
        warm = self._warm
        if warm_start is not None:
            _accept(box_data.start_from(self._work, self._iwork, np.ascontiguousarray(warm_start, np.float64)))
            warm = True
        self._status = self._solve_box(self._work, self._iwork, warm)
        if self._status:
            _accept(self._status)
        return self._answer

    def time_kernel(self, count: int, warm_start: Vector | None = None) -> tuple[Nanoseconds | None, Nanoseconds]:
        """Take P and q anew and solve from cold (warm with that setting) or from ``warm_start``, each timed."""
        updates, solves = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
        start = np.zeros(0) if warm_start is None else np.ascontiguousarray(warm_start, dtype=np.float64)
        self._status = _time(self._work, self._iwork, self._P, self._q, self._warm, start, updates, solves)
        _accept(self._status)
        return updates, solves

    def time_rows(self, rows: Matrix, forgetting: float) -> tuple[Matrix, Nanoseconds]:
        """Take rows one after the other; timed are the new P and q and the solve from the last active set."""
        rows = np.ascontiguousarray(rows, dtype=np.float64)
        answers, nanoseconds = np.empty((rows.shape[0], self._q.size)), np.empty(rows.shape[0], dtype=np.int64)
        self._status = _follow(self._work, self._iwork, self._P, self._q, rows, forgetting, answers, nanoseconds)
        _accept(self._status)
        return answers, nanoseconds

    def solution(self) -> Solution:
        """Return the last answer; ``extras`` count the linear systems, dual and proximal steps it took."""
        problem = Problem(self._P, self._q, lb=self._lb, ub=self._ub)
        state = self._iwork[STATE]
        return box_solution(problem, self._answer, self._status == OK, systems=int(state[SYSTEMS]),
                            dual_steps=int(state[DUAL_STEPS]), proximal_steps=int(state[PROXIMAL_STEPS]),
                            regularised=bool(state[SINGULAR]))


@compiled
def _time(work: Matrix, iwork: Integers, P: Matrix, q: Vector, warm: bool, x: Vector, updates: Integers,
          solves: Integers) -> int:
    status, warm = OK, warm or x.size > 0
    for k in range(updates.size):
        start = monotonic_ns()
        status = max(box_data.set_hessian(work, iwork, P), box_data.set_linear(work, iwork, q))
        between = monotonic_ns()
        if x.size > 0 and status == OK:
            status = box_data.start_from(work, iwork, x)
        status = solve_box(work, iwork, warm) if status == OK else status
        updates[k], solves[k] = between - start, monotonic_ns() - between
    return status


@compiled
def _follow(work: Matrix, iwork: Integers, P: Matrix, q: Vector, rows: Matrix, forgetting: float, answers: Matrix,
            nanoseconds: Integers) -> int:
    c = np.zeros(1)
    for k in range(rows.shape[0]):
        absorb(P, q, c, rows, k, k + 1, forgetting)
        start = monotonic_ns()
        status = max(box_data.set_hessian(work, iwork, P), box_data.set_linear(work, iwork, q))
        status = solve_box(work, iwork, True) if status == OK else status
        nanoseconds[k] = monotonic_ns() - start
        if status != OK:
            return status
        answers[k] = work[ANSWER, :q.size]
    return OK


def _accept(status: int) -> None:
    if status != OK:
        raise ValueError(f"box_active_set: {REASONS[status]}")
