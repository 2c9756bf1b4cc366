"""The projected difference equation w(k+1) = Proj(w(k) − η (P w(k) + q)), compiled for many steps.

It is the paper's discretisation of a projected dynamical system (equation (7)), the gradient projection method of
Goldstein (Bull. Amer. Math. Soc. 70 (1964) 709) and Levitin & Polyak (USSR Comput. Math. 6 (1966) 1). Why 0 < η < 2/λ_max(P):
the projection does not lengthen differences and I − η P shrinks them iff every |1 − η λ| < 1; on a free
direction with η λ > 2 the error grows by |1 − η λ| each step. Near the answer the slowest free direction
shrinks by 1 − η λ_min(P_FF), which is why condition 1e8 needs 1e8 steps.

P is stored by columns, multiplied by −η: one step at d = 18 is 54 multiply-adds of eight doubles, a clip, and where rows
couple variables, the projection of :mod:`solvers.kernels.cone_projection`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from solvers.compiled import aligned, compiled, entry
from solvers.kernels.box_factor import Integers
from solvers.kernels.cone_projection import Cone, project_coupled
from solvers.kernels.forgetting import absorb
from solvers.kernels.product import affine
from solvers.kernels.vector import load, store
from solvers.nanoclock import monotonic_ns
from solvers.protocol import Matrix, Vector
from solvers.vector8 import padded, sum8

W, V, SHIFT, CARRY, LO, HI, COLUMNS = range(7)
"""Rows of the work array: w, the point to project, −η q, w − η q, bounds; then the columns of −η P."""
EVERY = 16
"""Steps between two looks at the tolerance."""


def limit(P: Matrix) -> float:
    """The step below which the recursion converges for every q and every convex set: 2/λ_max(P); inf for P = 0.

    Raises
    ------
    ValueError
        P is not finite, or indefinite beyond rounding.

    Examples
    --------
    >>> limit(np.diag([1.0, 4.0]))
    0.5
    """
    if not np.isfinite(P).all():
        raise ValueError("P must be finite")
    spectrum = np.linalg.eigvalsh(P)
    if spectrum[0] < -1e-9 * abs(spectrum[-1]) or spectrum[-1] < 0:
        raise ValueError("P is indefinite beyond rounding, so the problem is not convex")
    return float(2 / spectrum[-1]) if spectrum[-1] > 0 else np.inf


@compiled
def run(work: Matrix, d: int, steps: int, threshold: float, A: Matrix, b: Vector, index: Integers, dual: Matrix,
        idual: Integers) -> int:
    """Take up to ``steps`` steps, fewer where one moves w by threshold or less (2-norm); how many were taken.

    A, b, index, dual and idual are those of a :class:`Cone`; −1 where its projection fails (w is then not a number).
    """
    width, moved = work.shape[1], 0.0
    for k in range(steps):
        affine(work, COLUMNS, d, W, CARRY, V)
        for c in range(0, width, 8):
            store(work, V, c, min(max(load(work, V, c), load(work, LO, c)), load(work, HI, c)))
        if index.size and project_coupled(work, V, A, b, index, dual, idual) != 0:
            work[W, :d] = np.nan
            return -1
        if threshold >= 0.0 and k % EVERY == EVERY - 1:
            moved = distance_squared(work, V, W)
        for c in range(0, width, 8):
            w = load(work, V, c)
            store(work, W, c, w)
            store(work, CARRY, c, w + load(work, SHIFT, c))
        if threshold >= 0.0 and k % EVERY == EVERY - 1 and moved <= threshold * threshold:
            return k + 1
    return steps


@compiled
def timed(work: Matrix, start: Matrix, d: int, steps: int, threshold: float, A: Matrix, b: Vector, index: Integers,
          dual: Matrix, idual: Integers, nanoseconds: Integers) -> None:
    """Run from the same start again and again and note the time of each run."""
    for i in range(nanoseconds.size):
        work[W], work[CARRY] = start[0], start[1]
        begin = monotonic_ns()
        run(work, d, steps, threshold, A, b, index, dual, idual)
        nanoseconds[i] = monotonic_ns() - begin


@compiled
def follow(work: Matrix, P: Matrix, q: Vector, rows: Matrix, forgetting: float, ratio: float, steps: int, A: Matrix,
           b: Vector, index: Integers, dual: Matrix, idual: Integers, answers: Matrix, nanoseconds: Integers) -> None:
    """Take ``steps`` steps after each row (ξ, x) of a stream, from where the last ones ended, and note their time.

    η = 2 ratio/‖P‖∞, which is never above 2 ratio/λ_max and costs d² additions instead of an eigenvalue.
    """
    d, c = q.size, np.zeros(1)
    for k in range(rows.shape[0]):
        absorb(P, q, c, rows, k, k + 1, forgetting)
        start, largest = monotonic_ns(), 0.0
        for i in range(d):
            total = 0.0
            for j in range(d):
                total += abs(P[i, j])
            largest = max(largest, total)
        eta = 2.0 * ratio / largest if largest > 0.0 else 1.0
        for i in range(d):
            for j in range(d):
                work[COLUMNS + i, j] = -eta * P[i, j]
            work[SHIFT, i] = -eta * q[i]
            work[CARRY, i] = work[W, i] + work[SHIFT, i]
        run(work, d, steps, -1.0, A, b, index, dual, idual)
        nanoseconds[k] = monotonic_ns() - start
        answers[k] = work[W, :d]


@compiled
def distance_squared(work: Matrix, i: int, j: int) -> float:
    """|work[i] − work[j]|², 2-norm."""
    square = 0.0
    for c in range(0, work.shape[1], 8):
        difference = load(work, i, c) - load(work, j, c)
        square += sum8(difference * difference)
    return square


class Recursion:
    """The recursion on one problem: data once, then as many steps as one likes.

    Parameters
    ----------
    d : int
        Number of variables.
    cone : Cone
        The feasible set.

    Examples
    --------
    >>> r = Recursion(1, Cone(None, None, np.zeros(1), np.ones(1)))
    >>> r.set_data(np.array([[2.0]]), np.array([-1.0]), 0.25)
    >>> r.start(np.zeros(1)); r.run(2), r.w.tolist()
    (2, [0.375])
    """

    def __init__(self, d: int, cone: Cone) -> None:
        self.d, self.cone = d, cone
        self._work = aligned(COLUMNS + d + 1, padded(d))
        self._work[LO, :d], self._work[HI, :d] = cone.lo, cone.hi
        self.w = self._work[W, :d]
        self._arguments = cone.A, cone.b, cone.index, cone.work, cone.iwork
        self._run = entry(run, self._work, d, 1, 0.0, *self._arguments)

    def set_data(self, P: Matrix | None, q: Vector, eta: float) -> None:
        """Take P, shape (d, d), unless it is None and eta the same; q, shape (d,); and the step eta."""
        if P is not None:
            self._work[COLUMNS:COLUMNS + self.d, :self.d] = -eta * P.T
        self._work[SHIFT, :self.d] = -eta * q

    def start(self, w: Vector) -> None:
        """Begin at the projection of w, shape (d,)."""
        self.w[:] = self.cone.project(w)
        self._work[CARRY] = self._work[W] + self._work[SHIFT]

    def run(self, steps: int, threshold: float = -1.0) -> int:
        """Step on; returns the number of steps taken."""
        taken: int = self._run(self._work, self.d, steps, threshold, *self._arguments)
        return taken

    def follow(self, P: Matrix, q: Vector, rows: Matrix, forgetting: float, ratio: float, steps: int,
               ) -> tuple[Matrix, Integers]:
        """Answers (N, d) and nanoseconds (N,) of :func:`follow`, which moves P and q on."""
        answers, nanoseconds = np.empty((rows.shape[0], self.d)), np.empty(rows.shape[0], dtype=np.int64)
        follow(self._work, P, q, rows, forgetting, ratio, steps, *self._arguments, answers, nanoseconds)
        return answers, nanoseconds

    def time(self, count: int, steps: int, threshold: float = -1.0) -> Integers:
        """Nanoseconds of ``count`` runs from where it stands, each from there, shape (count,)."""
        nanoseconds = np.empty(count, dtype=np.int64)
        start = self._work[[W, CARRY]]
        timed(self._work, start, self.d, steps, threshold, *self._arguments, nanoseconds)
        return nanoseconds


def trajectory(P: Matrix, q: Vector, lb: Vector, ub: Vector, w0: Vector, eta: float, steps: Sequence[int],
               G: Matrix | None = None, h: Vector | None = None) -> Matrix:
    """The iterates w(k) at the step counts k of ``steps`` (ascending), shape (len(steps), d).

    Examples
    --------
    >>> trajectory(np.eye(1), -np.ones(1), np.zeros(1), np.full(1, np.inf), np.zeros(1), 0.5, (1, 2, 3)).ravel().tolist()
    [0.5, 0.75, 0.875]
    """
    recursion = Recursion(q.size, Cone(G, h, lb, ub))
    recursion.set_data(P, q, eta)
    recursion.start(w0)
    found, done = np.empty((len(steps), q.size)), 0
    for i, k in enumerate(steps):
        if k < done:
            raise ValueError(f"step counts must ascend, and {k} comes after {done}")
        recursion.run(k - done)
        done = k
        found[i] = recursion.w
    return found
