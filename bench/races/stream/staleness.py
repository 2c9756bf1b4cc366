"""What late answers cost: the answer in use at each sample against the optimum of that sample.

With x the answer in use, clipped to the bounds, x* the optimum in doubles and g = P x* + q, the relative cost gap is

    (½ (x − x*)ᵀ P (x − x*) + gᵀ(x − x*)) / (V(x*) + c),

which is V(x) − V* without the cancellation of two nearly equal numbers. At the proven instants of the stream it is
computed in exact arithmetic instead, and the difference of the two there shows how far the doubles can be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.races.stream.stream_problem import StreamProblem, references
from solvers.certificate import exact_cost_gap
from solvers.compiled import compiled
from solvers.kernels.forgetting import absorb

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Index = NDArray[np.int64]


@compiled
def _gaps(P: Matrix, q: Vector, c: Vector, rows: Matrix, forgetting: float, lb: Vector, ub: Vector, best: Matrix,
          answers: Matrix, used: Index, gaps: Vector) -> None:
    d = q.size
    step = np.empty(d)
    for k in range(gaps.size):
        absorb(P, q, c, rows, k, k + 1, forgetting)
        for i in range(d):
            step[i] = min(max(answers[used[k], i], lb[i]), ub[i]) - best[k, i]
        value, gap = c[0], 0.0
        for i in range(d):
            Px, Pstep = 0.0, 0.0
            for j in range(d):
                Px += P[i, j] * best[k, j]
                Pstep += P[i, j] * step[j]
            value += (0.5 * Px + q[i]) * best[k, i]
            gap += (0.5 * Pstep + Px + q[i]) * step[i]
        gaps[k] = gap / value


@dataclass(frozen=True)
class Judge:
    """The optima of a stream, to hold answers against.

    Attributes
    ----------
    stream : StreamProblem
    best : array (N, d)
        The optimum of each sample in doubles.
    """

    stream: StreamProblem
    best: Matrix

    @classmethod
    def of(cls, stream: StreamProblem) -> Judge:
        """Find the optima of a stream."""
        return cls(stream, references(stream.start, stream.rows, stream.forgetting, stream.answer)[1:])

    def gaps(self, answers: Matrix, used: Index) -> Vector:
        """Relative cost gap of ``answers[used[k]]`` at each sample k, shape (len(used),); −1 is the start's answer."""
        s, d = self.stream, self.stream.d
        lb = np.full(d, -np.inf) if s.start.lb is None else s.start.lb
        ub = np.full(d, np.inf) if s.start.ub is None else s.start.ub
        gaps = np.empty(used.size)
        _gaps(s.start.P.copy(), s.start.q.copy(), np.array([s.c]), s.rows, s.forgetting, lb, ub, self.best,
              np.vstack([answers, s.answer]), np.where(used < 0, len(answers), used), gaps)
        return gaps

    def exact_gaps(self, answers: Matrix, used: Index) -> tuple[Index, Vector]:
        """The proven instants among the samples, and the gap there in exact arithmetic."""
        among = [instant for instant in self.stream.instants if instant.sample < used.size]
        gaps = [exact_cost_gap(i.qp, i.certificate, answers[used[i.sample]] if used[i.sample] >= 0 else self.stream.answer,
                               i.c).relative for i in among]
        return np.array([instant.sample for instant in among], dtype=np.int64), np.array(gaps)
