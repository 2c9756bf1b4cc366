"""Our exact solver for problems with bounds only: the dual active set method on the inverse.

    minimise ½ xᵀP x + qᵀx  subject to  lb ≤ x ≤ ub

With F the free variables and A those at a bound, x is the minimiser if x_F = −P_FF⁻¹ (q_F + P_FA x_A) is inside its
bounds and g_A = q_A + P_A x has the sign that holds each bound. Sweeping P on j (Beaton; Goodnight) moves j between A
and F, and swept on all, which costs d³ multiplications without a square root and proves P positive definite, it is
−P⁻¹: the start, every variable free. From there the variable whose bound is broken and gains most, violation²/|M_jj|,
goes to its bound, by one column M_j of the tableau, and a bound whose multiplier vanishes on the way is let go
(Goldfarb & Idnani), until nothing is broken: the dual cost rises with each, so no active set returns. One step of
refinement with the true residual q + P x then makes rounding that of the data.

For a singular P, a small proximal term about the previous iterate is added, which vanishes in the limit
(``solvers/core/box_proximal.c``).

``update`` is one call of a compiled function that checks, scales and inverts P, and ``solve`` is another, on work
arrays allocated by ``setup``. Of the 1.7 µs for both at d = 18, called from Python on one machine, the two calls and
the clock took 0.7, the checked copy 0.1, the sweeps 0.4, the first point and six exchanges 0.3, refinement and answer
0.2.

Sources: A. E. Beaton, The use of special matrix operators in statistical calculus, ETS RB-64-51, 1964; J. H. Goodnight,
American Statistician 33 (1979) 149; D. Goldfarb, A. Idnani, Math. Programming 27 (1983) 1; R. T. Rockafellar, SIAM J.
Control Optim. 14 (1976) 877.
"""

from functools import partial
from typing import Any

import numpy as np
from qpsolvers import Problem, Solution

from solvers.core import CAPPED, OK, bindings, block, padded, parts
from solvers.ours import OurSolver
from solvers.protocol import Matrix, Nanoseconds, Timings, Vector, box_solution, dense, only_box
from solvers.timed_calls import follow_rows, time_calls

COUNTS = ("exchanges", "refinements", "proximal_steps")
"""The counters in the head of the state, in their order (BoxHead in box.h)."""


class BoxActiveSet(OurSolver):
    """Exact box QP solver, cold or warm; it has no tolerance, so its ladder has one rung.

    Settings
    --------
    warm : bool, default False
        Whether ``solve()`` starts from the last active set, so that its time depends on earlier solves. If not, it
        starts from "all free" and the answer depends on the data alone, to the last bit. ``solve(x)`` always starts
        from the active set of x.
    most_exchanges : int, default 0
        Limit of exchanges; a solve that reaches it ends at a feasible point, from which a warm solve continues. 0 for
        no limit.

    Examples
    --------
    >>> import numpy as np, qpsolvers
    >>> s = BoxActiveSet()
    >>> s.setup(qpsolvers.Problem(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([1.0, -4.0]), lb=np.zeros(2)))
    >>> s.solve().tolist()
    [0.0, 2.0]
    """

    name = "box_active_set"
    algorithm = "dual active set"
    warm_startable = True

    def setup(self, problem: Problem) -> None:
        """Allocate, scale and invert.

        Raises
        ------
        Unsupported
            The problem has general rows.
        ValueError
            A number is NaN or infinite where it may not be, P is not symmetric or indefinite beyond rounding, or bounds
            cross.
        """
        self._lb, self._ub = only_box(problem, self.name)
        P, q = dense(problem)
        self._warm = bool(self.settings.get("warm", False))
        self.state = block(bindings.box_bytes(q.size))
        self.accept(bindings.box_setup(self.state, self._lb, self._ub))
        self._parts = parts(self.state, bindings.box_places(self.state))
        self._answer = self._parts["answer"]
        self.part("cap").view(np.int32)[0] = int(self.settings.get("most_exchanges", 0))
        self._status = OK
        self.update(P, q)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Take new P or q of the same shape. After a ValueError, as in ``setup``, there is no valid problem."""
        try:
            status = bindings.box_set_data(self.state, P, q)
        except (TypeError, ValueError, BufferError):  # arrays of another type or layout are converted
            status = bindings.box_set_data(self.state, self._converted(P, 2), self._converted(q, 1))
        if status:
            self.accept(status)

    def _converted(self, data: Any, ndim: int) -> Matrix | None:
        if data is None:
            return None
        array, shape = np.array(data, np.float64, order="C"), (self._answer.size,) * ndim
        if array.shape != shape:
            raise ValueError(f"{self.name}: new data must have the shape {shape}, not {array.shape}")
        return array

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the minimiser, shape (d,), a view that the next call overwrites.

        Raises
        ------
        ValueError
            The problem is unbounded below.
        """
        warm = self._warm
        if warm_start is not None:
            self.accept(bindings.box_start(self.state, self._converted(warm_start, 1)))
            warm = True
        self._status = bindings.box_solve(self.state, warm)
        if self._status:
            self.accept(self._status)
        return self._answer

    def time_kernel(self, P: Matrix, q: Matrix, warm_start: Vector | None = None, most_ns: float = np.inf) -> Timings:
        """Take each P and q and solve cold (warm with that setting) or from ``warm_start``, timed."""
        self._status, timings = time_calls(
            partial(bindings.time_box, self.state, self._warm), P, q, warm_start, most_ns
        )
        self.accept(self._status)
        return timings

    def time_rows(self, rows: Matrix, forgetting: float) -> tuple[Matrix, Nanoseconds]:
        """Update and solve after each row, from the last active set; the new data of a row are not timed."""
        self._status, answers, nanoseconds = follow_rows(
            partial(bindings.box_follow, self.state), *self._data(), rows, forgetting
        )
        self.accept(self._status)
        return answers, nanoseconds

    def solution(self) -> Solution:
        """Return the last answer.

        ``extras`` has the numbers of exchanges, refinement steps and proximal steps, ``regularised`` (P is singular)
        and ``capped`` (``most_exchanges`` ended the solve before the optimum).
        """
        P, q = self._data()
        counts = dict(zip(COUNTS, self.part("counts").view(np.int32)[: len(COUNTS)].tolist(), strict=True))
        return box_solution(
            Problem(P, q, lb=self._lb, ub=self._ub),
            self._answer,
            self._status == OK,
            **counts,
            regularised=bool(self.part("singular").view(np.int32)[0]),
            capped=self._status == CAPPED,
        )

    def _data(self) -> tuple[Matrix, Vector]:
        """The present P and q; P from its scaled copy, which is exact."""
        d = self._lb.size
        P = self.part("P").reshape(d, padded(d))[:, :d]
        return P / self.part("scale") / self.part("scale")[:, None], self.part("raw_q").copy()
