"""Data that a solver cannot have seen: mixtures of neighbouring windows of a problem's recording.

    P = Σ θ_k P_k,   q = Σ θ_k q_k,   c = Σ θ_k c_k,    θ ≥ 0, Σ θ_k = 1

is the data basis of all windows with random weights, under the constraints of the problem; V + c stays a sum of
squares. Without windows every entry of q is reduced by up to a tenth, all entries by the same share if P is singular,
so that a bounded problem stays bounded. The parent judges a random sample of the answers, against optima that are
proven afterwards; no solver process can know them.
"""

import math
from collections.abc import Sequence
from functools import cache, cached_property
from itertools import pairwise

import numpy as np
from qpsolvers import Problem

from bench.problems.protocol import CertifiedForm
from solvers.arrays import Matrix
from solvers.certificate import NotCertified, certify

LEAST = 0.9
"""Smallest factor of q for a problem without windows."""
STRETCHES = (1, 3, 20, 60, 300)
"""Ends of the ranges of calls; one answer of each range is judged."""


class FreshData:
    """Mixtures that only the process that draws them knows.

    Parameters
    ----------
    form : CertifiedForm
    count : int
        Number of calls whose answers may be judged.
    seed : int or sequence of int, optional
        Random by default.

    Attributes
    ----------
    sample : tuple of int
        The calls whose answers are judged.
    """

    def __init__(self, form: CertifiedForm, count: int, seed: int | Sequence[int] | None = None) -> None:
        self._form, self.count = form, count
        self._generator = np.random.default_rng(seed)
        windows = form.windows
        P = form.qp.P if isinstance(form.qp.P, np.ndarray) else form.qp.P.toarray()  # update takes dense data
        self._P, self._q = [P, *(window.P for window in windows)], [form.qp.q, *(window.q for window in windows)]
        self._c = np.array([form.c, *(window.c for window in windows)])
        self._factors_of_q = 0 if windows else form.qp.q.size if math.isfinite(form.condition) else 1
        self._shares, self._factors = self._drawn(count)
        ends = [0, *(end for end in STRETCHES if end < count), min(count, STRETCHES[-1])]
        self.sample = tuple(int(self._generator.integers(low, high)) for low, high in pairwise(ends) if low < high)
        self.certified = cache(self._certify)
        """The program of a call with its certified optimum; None if it cannot be proven."""

    def block(self, first: int, last: int) -> tuple[Matrix, Matrix]:
        """P (n, d, d) and q (n, d) of calls ``first`` to ``last`` − 1; P is exactly symmetric if the problem's is."""
        return self._mixed(self._shares[first:last], self._factors[first:last])

    def unseen(self, count: int) -> tuple[Matrix, Matrix]:
        """``count`` new P and q; their answers are not judged."""
        return self._mixed(*self._drawn(count))

    def _drawn(self, count: int) -> tuple[Matrix, Matrix]:
        """Random shares of the windows, and factors of q."""
        factors = (
            self._generator.uniform(LEAST, 1.0, (count, self._factors_of_q))
            if self._factors_of_q
            else np.ones((count, 1))
        )
        return self._generator.dirichlet(np.ones(len(self._P)), size=count), factors

    def _mixed(self, shares: Matrix, factors: Matrix) -> tuple[Matrix, Matrix]:
        P, q = np.zeros((len(shares), *self._P[0].shape)), np.zeros((len(shares), self._q[0].size))
        for k, share in enumerate(shares.T):
            P += share[:, None, None] * self._P[k]
            q += share[:, None] * self._q[k]
        return P, q * factors

    def _certify(self, call: int) -> CertifiedForm | None:
        (P,), (q,) = self.block(call, call + 1)
        qp, c = self._form.qp, float(self._shares[call] @ self._c)
        mixed = Problem(P, q, qp.G, qp.h, qp.A, qp.b, qp.lb, qp.ub)
        try:
            proof = certify(mixed, np.array(self._form.certificate.x))
        except NotCertified:  # such an answer is not judged
            return None
        return CertifiedForm(mixed, c, self._form.to_weights, proof, cost_unit=self._form.cost_unit)

    @cached_property
    def calls_at_once(self) -> int:
        """Number of calls that fit into a message of a megabyte."""
        return max(1, 2**20 // (8 * self._P[0].size))
