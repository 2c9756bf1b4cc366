"""The state of a projected gradient method in C, see ``solvers/core/descent.h``: data once, then as many steps as one
likes."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from solvers.core import NOT_FINITE, OK, REASONS, bindings, block, parts
from solvers.protocol import Matrix, Timings, Vector
from solvers.timed_calls import time_calls


class ProjectedGradient:
    """One problem with bounds lb ≤ x ≤ ub, in the variables w = x/D.

    Parameters
    ----------
    lb, ub : arrays, shape (d,)
        Bounds, infinite where there is none.
    name : str
        Whose errors are raised.

    Attributes
    ----------
    state : array of bytes
        All there is to save and restore.
    w : array, shape (d,)
        Where it stands, a view.
    D : array, shape (d,)
        The scale of the variables, a view.

    Raises
    ------
    ValueError
        Bounds cross or are NaN.

    Examples
    --------
    >>> import numpy as np
    >>> d = ProjectedGradient(np.zeros(1), np.ones(1), "example")
    >>> d.take(np.array([[2.0]]), np.array([-1.0]), 0.25, scaled=False)
    >>> d.start(None)
    >>> d.run(2), d.w.tolist(), d.eta
    (2, [0.375], 0.25)
    """

    def __init__(self, lb: Vector, ub: Vector, name: str) -> None:
        self._name = name
        self.state = block(bindings.descent_bytes(lb.size))
        self._accept(bindings.descent_setup(self.state, lb, ub))
        numbers, vectors = self.state.view(np.float64), parts(self.state, bindings.descent_places(self.state))
        self.w, self.D, self._answer = vectors["w"], vectors["D"], vectors["answer"]
        self._eta, self._taken, self._met = numbers[2:3], self.state.view(np.int64)[3:4], self.state.view(np.int32)[8:9]

    def take(self, P: Matrix | None, q: Vector | None, ratio: float, scaled: bool) -> None:
        """Take P (d, d) or q (d,); the step is ``ratio`` times 2/λ_max, 1 where P is 0; ValueError where they cannot
        be."""
        status = bindings.descent_take(self.state, P, q, ratio, int(scaled))
        if status == NOT_FINITE:
            which = "q" if P is None or np.isfinite(P).all() else "P"
            raise ValueError(f"{self._name}: {which} must be finite")
        self._accept(status)

    def start(self, x: Vector | None) -> None:
        """Begin at the projection of x (d,), of 0 for None."""
        bindings.descent_start(self.state, None if x is None else np.ascontiguousarray(x, dtype=np.float64))

    def run(self, steps: int, tolerance: float = -1.0) -> int:
        """Take plain steps; returns how many. It ends where one moves w by ``tolerance`` η |D q| or less (2-norms),
        looked at every 16."""
        taken: int = bindings.projected_steps(self.state, steps, tolerance)
        return taken

    def time(
        self,
        loop: Callable[..., int],
        steps: int,
        tolerance: float,
        ratio: float,
        scaled: bool,
        P: Matrix,
        q: Matrix,
        start: Vector | None,
        most_ns: float,
    ) -> Timings:
        """Time ``take`` and a run from ``start`` for each of P (n, d, d) and q (n, d), see
        :meth:`solvers.protocol.Solver.time_kernel`."""
        status, timings = time_calls(
            partial(loop, self.state, ratio, int(scaled), steps, tolerance), P, q, start, most_ns
        )
        self._accept(status)
        return timings

    def answer(self) -> Vector:
        """x (d,) where it stands, at a bound to the last bit where w is at it."""
        bindings.descent_answer(self.state)
        return self._answer.copy()

    @property
    def eta(self) -> float:
        """The step."""
        return float(self._eta[0])

    @property
    def taken(self) -> int:
        """Steps of the last run."""
        return int(self._taken[0])

    @property
    def met(self) -> bool:
        """Whether the last run ended by its tolerance."""
        return bool(self._met[0])

    def _accept(self, status: int) -> None:
        if status != OK:
            raise ValueError(f"{self._name}: {REASONS[status]}")


def limit(P: Matrix) -> float:
    """The step below which the recursion converges for every q and every convex set: 2/λ_max(P); inf for P = 0.

    Raises
    ------
    ValueError
        P is not finite, not symmetric, or indefinite beyond rounding.

    Examples
    --------
    >>> limit(np.diag([1.0, 4.0]))
    0.5
    """
    d = P.shape[0]
    descent = ProjectedGradient(np.full(d, -np.inf), np.full(d, np.inf), "limit")
    descent.take(np.ascontiguousarray(P, dtype=np.float64), None, 1.0, scaled=False)
    return descent.eta if np.any(P) else np.inf


def trajectory(P: Matrix, q: Vector, lb: Vector, ub: Vector, w0: Vector, eta: float, steps: Sequence[int]) -> Matrix:
    """The iterates w(k) at the step counts k of ``steps`` (ascending), shape (len(steps), d).

    Examples
    --------
    >>> zero, upper = np.zeros(1), np.full(1, np.inf)
    >>> trajectory(np.eye(1), -np.ones(1), zero, upper, zero, 0.5, (1, 2, 3)).ravel().tolist()
    [0.5, 0.75, 0.875]
    """
    descent = ProjectedGradient(lb, ub, "trajectory")
    descent.take(np.ascontiguousarray(P), np.ascontiguousarray(q), eta / limit(P), scaled=False)
    descent.start(w0)
    found, done = np.empty((len(steps), q.size)), 0
    for i, k in enumerate(steps):
        if k < done:
            raise ValueError(f"step counts must ascend, and {k} comes after {done}")
        descent.run(k - done)
        done = k
        found[i] = descent.w
    return found
