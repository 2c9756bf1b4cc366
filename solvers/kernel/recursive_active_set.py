"""The exact optimum at every sample: a box QP whose data grow by one row at a time.

    P ← λ P + μ ξ ξᵀ,   q ← λ q + μ ξ x     at every row (ξ, x),   minimise ½ vᵀP v + qᵀv over lb ≤ v ≤ ub

The method, see ``solvers/core/recursive.h``: each row changes the Gram matrix, swept on the free variables, by a matrix
of rank one, and the last row of the swept matrix is the answer. ``solve`` only returns it: restoring optimality is part
of taking the data.

If there is a minimum, it is found. The swept matrix is recomputed by the refresh rule of ``recursive_rows.c``, which
bounds its drift, and at once if a pivot is singular, positive definiteness is lost or the exchanges cycle; if that does
not help, the cold exact solver takes over (``recursive_start.c``). An error remains only for data without a minimum.
"""

from collections.abc import Mapping
from functools import partial

import numpy as np
from qpsolvers import Problem, Solution

from solvers.core import CAPPED, NOT_FINITE, OK, bindings, block, padded, parts
from solvers.ours import OurSolver
from solvers.protocol import Matrix, Nanoseconds, Timings, Vector, box_solution, dense, only_box
from solvers.timed_calls import time_calls

LARGEST = 1e100
"""LARGEST_ENTRY of recursive.h: smallest magnitude of an entry of a row that is refused."""
FOUND = 1e-12
"""Largest relative violation of the optimality conditions by an answer that counts as found."""


class RecursiveActiveSet(OurSolver):
    """Exact box QP solver that takes rows.

    Settings
    --------
    forgetting : float, default 1
        λ in (0, 1] per row.
    weight : float, default 1 − λ, or 1 without forgetting
        μ, the weight of a new row. With 1 − λ, P and q are weighted means.
    proximal : float, default 1e-10
        Coefficient of a proximal term about the answer at the last refresh, relative to the diagonal of P (at most its
        mean). With 0 there is such a term only while P is singular on the free variables.
    most_exchanges : int, default 0
        Limit of exchanges per row; at the limit the answer is feasible, and the next row continues. 0 for no limit.

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

    name = "recursive_active_set"
    algorithm = "principal pivoting on a recursively updated inverse"
    takes_rows = True

    def setup(self, problem: Problem) -> None:
        """Allocate, and find the optimum of the initial data.

        Raises
        ------
        Unsupported
            The problem has general rows.
        ValueError
            A setting is out of range, a number is NaN or infinite where it may not be, bounds cross, P is not symmetric
            or indefinite, or the problem is unbounded.
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
        state, (P, q) = block(bindings.recursive_bytes(d)), dense(problem)
        self.accept(bindings.recursive_setup(state, lb, ub, forgetting, weight, proximal))
        places = bindings.recursive_places(state)
        found = parts(state, places)
        found["cap"].view(np.int32)[0] = int(self.settings.get("most_exchanges", 0))
        self.accept(bindings.recursive_begin(state, P, q))
        self._lb, self._ub, self._P, self._q, self.state, self._places, self._parts = lb, ub, P, q, state, places, found
        self._row, self._answer, self._forgetting, self._capped = (
            np.zeros(d + 1),
            self.part("answer"),
            forgetting,
            False,
        )

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Start again from other data of the same size; refused data (ValueError, as in ``setup``) change nothing."""
        P = self._P if P is None else np.array(P, dtype=np.float64, order="C")
        q = self._q if q is None else np.array(q, dtype=np.float64)
        if P.shape != self._P.shape or q.shape != self._q.shape:
            raise ValueError(f"{self.name}: P {P.shape} and q {q.shape} are not of the size of the problem set up")
        self.accept(bindings.recursive_begin(self.state, P, q))
        self._P, self._q, self._capped = P, q, False

    def append(self, row: Vector, target: float) -> None:
        """Add the squared error ½ (vᵀξ + x)² of a row ξ (d,) and a number x to the cost; ValueError if a number is not
        finite."""
        if np.shape(row) != self._q.shape:
            raise ValueError(f"{self.name}: a row has {self._q.size} numbers, not shape {np.shape(row)}")
        self._row[:-1], self._row[-1] = row, target
        status = bindings.recursive_append(self.state, self._row)
        if status == NOT_FINITE:
            raise ValueError(f"{self.name}: the row holds a number that is not finite, or above {LARGEST:g}")
        self._capped = status == CAPPED
        if status not in (OK, CAPPED):
            self.accept(bindings.recursive_recover(self.state))  # start again from all data by the cold exact solver

    def time_rows(self, rows: Matrix, forgetting: float) -> tuple[Matrix, Nanoseconds]:
        """Take rows in one compiled call; the update of the data is part of the algorithm and timed."""
        if forgetting != self._forgetting:
            raise ValueError(f"{self.name}: was set up with forgetting {self._forgetting}, not {forgetting}")
        rows = np.ascontiguousarray(rows, dtype=np.float64)
        d = self._q.size
        if rows.ndim != 2 or rows.shape[1] != d + 1:
            raise ValueError(f"{self.name}: rows must have shape (N, {d + 1}), not {rows.shape}")
        usable = (np.abs(rows) < LARGEST).all(axis=1)
        if not usable.all():
            raise ValueError(
                f"{self.name}: row {int(np.argmin(usable))} holds a number that is not finite, or above {LARGEST:g}"
            )
        answers, nanoseconds = np.empty((rows.shape[0], d)), np.empty(rows.shape[0], dtype=np.int64)
        status = bindings.recursive_append_rows(self.state, rows, answers, nanoseconds)
        self._capped = status == CAPPED
        self.accept(status)
        return answers, nanoseconds

    def time_kernel(self, P: Matrix, q: Matrix, warm_start: Vector | None = None, most_ns: float = np.inf) -> Timings:
        """Start again from each P and q, which includes finding the optimum; all of it is timed as the solve."""
        status, timings = time_calls(partial(bindings.time_recursive, self.state), P, q, warm_start, most_ns)
        self.accept(status)
        last = timings[0].size - 1
        self._P, self._q, self._capped = np.array(P[last]), np.array(q[last]), status == CAPPED
        return timings

    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the minimiser (d,) for all data so far; ``warm_start`` is not used."""
        return self._answer

    def problem(self, of: Mapping[str, Vector] | None = None) -> Problem:
        """Return the program that the answer solves, proximal term included, in the user's variables; ``of`` may be the
        parts of a copy of the state."""
        d, of = self._lb.size, self._parts if of is None else of
        row_weight, root_weight = of["row_weight"]
        decay = row_weight / root_weight**2
        G = of["G"].reshape(padded(d + 1), -1)[: d + 1, : d + 1]
        G = (np.triu(G) + np.triu(G, 1).T) * decay
        rho, origin, sign, centre = (of[name] for name in ("rho", "origin", "sign", "centre"))
        P = sign[:, None] * G[:d, :d] * sign + np.diag(rho * decay)
        q = sign * (G[:d, d] - rho * decay * centre)
        return Problem(P, q - P @ origin, lb=self._lb, ub=self._ub)

    def solution(self) -> Solution:
        """Return the answer; ``extras`` has the numbers of exchanges, refreshes and cold starts, and the ``error``: the
        violation of the optimality conditions relative to the terms of the gradient.

        An answer counts as found if its error is at most FOUND. Rounding since the last refresh may have made it larger
        (the error of the cost is of second order in it); then a copy of the state is refreshed, and solved by the cold
        solver if that is not enough. The state itself is not changed, so later answers do not depend on this call.
        """
        state, capped = block(self.state.size), self._capped
        state[:] = self.state
        for renew in (bindings.recursive_refresh, bindings.recursive_recover):
            if not capped and not bindings.recursive_error(state) <= FOUND:
                capped = renew(state) == CAPPED
        found = parts(state, self._places)
        exchanges, refreshes, cold_starts, _ = found["counts"].view(np.uint32).tolist()
        error, x = bindings.recursive_error(state), found["answer"].copy()
        return box_solution(
            self.problem(found),
            x,
            error <= FOUND,
            status="capped" if capped else "solved",
            exchanges=exchanges,
            refreshes=refreshes,
            cold_starts=cold_starts,
            error=error,
        )
