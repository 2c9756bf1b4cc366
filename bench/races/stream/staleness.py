"""What late answers cost: the answer in use at each sample against the optimum of that sample.

With x the answer in use, clipped to the bounds, x* the optimum in doubles and g = P x* + q, the relative cost gap is

    (½ (x − x*)ᵀ P (x − x*) + gᵀ(x − x*)) / (V(x*) + c),

which is V(x) − V* without the cancellation of two nearly equal numbers. At the proven instants of the stream it is
computed in exact arithmetic instead, and the difference of the two there shows how far the doubles can be trusted.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from bench.races.stream.stream_problem import StreamProblem, references
from solvers.arrays import Index, Matrix, Vector
from solvers.certificate import exact_cost_gap
from solvers.forgetting import absorb


@dataclass(frozen=True)
class Judge:
    """The optima of a stream, to hold answers against."""

    stream: StreamProblem
    best: Matrix
    """The optimum of each sample in doubles. Shape (N, d)."""

    @classmethod
    def of(cls, stream: StreamProblem) -> Self:
        """Find the optima of a stream."""
        return cls(stream, references(stream.start, stream.rows, stream.forgetting, stream.answer)[1:])

    def gaps(self, answers: Matrix, used: Index) -> Vector:
        """Relative cost gap of ``answers[used[k]]`` at each sample k, shape (len(used),); −1 is the start's answer."""
        s, d = self.stream, self.stream.d
        lb = np.full(d, -np.inf) if s.start.lb is None else s.start.lb
        ub = np.full(d, np.inf) if s.start.ub is None else s.start.ub
        P, q, c = s.start.P.copy(), s.start.q.copy(), np.array([s.c])
        gaps, in_use = (
            np.empty(used.size),
            np.vstack([answers, s.answer]).clip(lb, ub)[np.where(used < 0, len(answers), used)],
        )
        for k, (best, step) in enumerate(zip(self.best, in_use - self.best[: used.size], strict=False)):
            absorb(P, q, c, s.rows, k, k + 1, s.forgetting)
            Px = P @ best
            gaps[k] = ((0.5 * (P @ step) + Px + q) @ step) / (c[0] + (0.5 * Px + q) @ best)
        return gaps

    def exact_gaps(self, answers: Matrix, used: Index) -> tuple[Index, Vector]:
        """The proven instants among the samples, and the gap there in exact arithmetic."""
        among = [instant for instant in self.stream.instants if instant.sample < used.size]
        gaps = [
            exact_cost_gap(
                i.qp, i.certificate, answers[used[i.sample]] if used[i.sample] >= 0 else self.stream.answer, i.c
            ).relative
            for i in among
        ]
        return np.array([instant.sample for instant in among], dtype=np.int64), np.array(gaps)
