"""Nesterov's projected gradient method with adaptive restart, compiled for many steps.

    w(k+1) = clip(y(k) − η (P y(k) + q)),    y(k+1) = w(k+1) + β(k) (w(k+1) − w(k)),    η = 1/λ_max(P),
    β(k) = (t(k) − 1)/t(k+1),  t(k+1) = (1 + √(1 + 4 t(k)²))/2,  t(0) = 1

(Nesterov, Soviet Math. Dokl. 27 (1983) 372; Beck & Teboulle, SIAM J. Imaging Sci. 2 (2009) 183). The momentum is right for a
problem of unknown convexity only at the start; later it overshoots. So t goes back to 1 and y to w whenever momentum
and gradient disagree, (y(k) − w(k+1))ᵀ(w(k+1) − w(k)) > 0 (O'Donoghue & Candès, Found. Comput. Math. 15 (2015) 715), and the
rate becomes linear with √(condition number of P_FF) instead of the condition number: with a unit diagonal of P some hundred steps
(median 460 on the set ``paper``, 500 on ``excitation``, most 4000) to a relative cost gap of 1e-9, where the plain recursion
takes thousands. A small controller that affords one step a sample takes these one at a time, from where it stands.
"""

from __future__ import annotations

import numpy as np

from solvers.compiled import aligned, compiled, entry
from solvers.kernels.box_factor import Integers
from solvers.kernels.product import affine
from solvers.kernels.projected_step import distance_squared
from solvers.kernels.vector import load, store
from solvers.nanoclock import monotonic_ns
from solvers.protocol import Matrix, Vector
from solvers.vector8 import padded, splat8, sum8

W, V, SHIFT, CARRY, LO, HI, Y, COLUMNS = range(8)
"""Rows of the work array: w, the new w, −η q, y − η q, bounds, y; then the columns of −η P."""


@compiled
def run(work: Matrix, d: int, steps: int, tolerance: float) -> int:
    """Take up to ``steps`` steps from w, fewer where the projected gradient is small; how many were taken.

    The projected gradient is (y − w)/η; small is ``tolerance`` times max(|q|, |P w(0) + q|), all in the 2-norm.
    """
    width, t = work.shape[1], 1.0
    for c in range(0, width, 8):
        w = load(work, W, c)
        store(work, Y, c, w)
        store(work, CARRY, c, w + load(work, SHIFT, c))
        store(work, V, c, splat8(0.0))
    scale = distance_squared(work, SHIFT, V)
    affine(work, COLUMNS, d, Y, CARRY, V)
    threshold = tolerance * tolerance * max(scale, distance_squared(work, V, Y))
    for k in range(steps):
        affine(work, COLUMNS, d, Y, CARRY, V)
        agreement, square = splat8(0.0), splat8(0.0)
        for c in range(0, width, 8):
            w = min(max(load(work, V, c), load(work, LO, c)), load(work, HI, c))
            back = load(work, Y, c) - w
            agreement = agreement + back * (w - load(work, W, c))
            square = square + back * back
            store(work, V, c, w)
        t_next = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * t * t))
        beta = (t - 1.0) / t_next
        t = t_next
        if sum8(agreement) > 0.0:
            beta, t = 0.0, 1.0
        for c in range(0, width, 8):
            w = load(work, V, c)
            y = w + beta * (w - load(work, W, c))
            store(work, W, c, w)
            store(work, Y, c, y)
            store(work, CARRY, c, y + load(work, SHIFT, c))
        if sum8(square) <= threshold:
            return k + 1
    return steps


@compiled
def timed(work: Matrix, start: Vector, d: int, steps: int, tolerance: float, nanoseconds: Integers) -> None:
    """Run from the same start again and again and note the time of each run."""
    for i in range(nanoseconds.size):
        work[W] = start
        begin = monotonic_ns()
        run(work, d, steps, tolerance)
        nanoseconds[i] = monotonic_ns() - begin


class Acceleration:
    """The method on one box problem; the vocabulary of :class:`solvers.kernels.projected_step.Recursion`."""

    def __init__(self, d: int) -> None:
        self.d = d
        self._work = aligned(COLUMNS + d + 1, padded(d))
        self.w = self._work[W, :d]
        self._run = entry(run, self._work, d, 1, 0.0)

    def set_bounds(self, lo: Vector, hi: Vector) -> None:
        """Take the bounds, shape (d,)."""
        self._work[LO, :self.d], self._work[HI, :self.d] = lo, hi

    def set_data(self, P: Matrix | None, q: Vector, eta: float) -> None:
        """Take P, shape (d, d), unless it is None and eta the same; q, shape (d,); and the step eta."""
        if P is not None:
            self._work[COLUMNS:COLUMNS + self.d, :self.d] = -eta * P.T
        self._work[SHIFT, :self.d] = -eta * q

    def start(self, w: Vector) -> None:
        """Begin at w, shape (d,), clipped."""
        np.clip(w, self._work[LO, :self.d], self._work[HI, :self.d], out=self.w)

    def run(self, steps: int, tolerance: float) -> int:
        """Step on, with momentum anew; returns the number of steps taken."""
        taken: int = self._run(self._work, self.d, steps, tolerance)
        return taken

    def time(self, count: int, steps: int, tolerance: float) -> Integers:
        """Nanoseconds of ``count`` runs from where it stands, each from there, shape (count,)."""
        nanoseconds = np.empty(count, dtype=np.int64)
        timed(self._work, self._work[W].copy(), self.d, steps, tolerance, nanoseconds)
        return nanoseconds
