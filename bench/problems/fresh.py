"""Data that a solver cannot have seen: mixtures of neighbouring windows of the recording that a problem comes from.

    P = Σ θ_k P_k,   q = Σ θ_k q_k,   c = Σ θ_k c_k,    θ ≥ 0, Σ θ_k = 1

is the data basis of the windows, each with a weight of its own, under the constraints of the problem; V + c stays a sum
of squares. A problem without windows has each entry of its q made smaller by up to a tenth, all by the same share where
P is singular, by which a bounded problem stays bounded. What is judged of the answers is a sample that the parent
draws, against optima that are proven only then, and that no process of a solver can know.
"""

from collections.abc import Sequence
from functools import cache, cached_property

import numpy as np
from qpsolvers import Problem

from bench.problems.protocol import CertifiedForm
from solvers.arrays import Matrix
from solvers.certificate import NotCertified, certify

LEAST = 0.9
"""Smallest factor of q for a problem without windows."""
STRETCHES = (1, 3, 20, 60, 300)
"""Ends of the stretches of calls out of each of which one answer is judged."""


class FreshData:
    """Mixtures; nobody but the process that makes them knows which.

    Parameters
    ----------
    form : CertifiedForm
    count : int
        Calls whose answers may be judged.
    seed : int or sequence of int, optional
        The system's randomness by default.

    Attributes
    ----------
    sample : tuple of int
        Calls whose answers are judged.
    """

    def __init__(self, form: CertifiedForm, count: int, seed: int | Sequence[int] | None = None) -> None:
        self._form, self.count = form, count
        self._chance = np.random.default_rng(seed)
        windows = form.windows
        P = form.qp.P if isinstance(form.qp.P, np.ndarray) else form.qp.P.toarray()  # update takes dense data
        self._P, self._q = [P, *(window.P for window in windows)], [form.qp.q, *(window.q for window in windows)]
        self._c = np.array([form.c, *(window.c for window in windows)])
        self._apart = 0 if windows else form.qp.q.size if _is_definite(P) else 1
        self._shares, self._factors = self._drawn(count)
        ends = [min(end, count) for end in STRETCHES]
        self.sample = tuple(
            sorted(
                {
                    int(self._chance.integers(low, high))
                    for low, high in zip([0, *ends], ends, strict=False)
                    if low < high
                }
            )
        )
        self.certified = cache(self._certify)
        """The program of a call with its proven optimum; None where there is no proof."""

    def block(self, first: int, last: int) -> tuple[Matrix, Matrix]:
        """P (n, d, d) and q (n, d) of the calls from ``first`` to ``last`` − 1, symmetric to the last bit where the
        problem is."""
        return self._mixed(self._shares[first:last], self._factors[first:last])

    def unseen(self, count: int) -> tuple[Matrix, Matrix]:
        """So many P and q that were not there before; their answers are not judged."""
        return self._mixed(*self._drawn(count))

    def _drawn(self, count: int) -> tuple[Matrix, Matrix]:
        """Shares of the windows, and factors of q."""
        factors = self._chance.uniform(LEAST, 1.0, (count, self._apart)) if self._apart else np.ones((count, 1))
        return self._chance.dirichlet(np.ones(len(self._P)), size=count), factors

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
        except NotCertified:  # nothing is judged on what cannot be proven
            return None
        return CertifiedForm(mixed, c, self._form.to_weights, proof, cost_unit=self._form.cost_unit)

    @cached_property
    def calls_at_once(self) -> int:
        """How many fit into a message of a megabyte."""
        return max(1, 2**20 // (8 * self._P[0].size))


def _is_definite(P: Matrix) -> bool:
    """Whether P is positive definite beyond rounding."""
    values = np.linalg.eigvalsh(P)
    return bool(values[0] > P.shape[0] * np.finfo(float).eps * values[-1])
