"""Data that a solver cannot have seen: mixtures of neighbouring windows of a problem's recording.

    P = Σ θ_k P_k,   q = Σ θ_k q_k,   c = Σ θ_k c_k,    θ ≥ 0, Σ θ_k = 1

is the data basis of all windows with random weights, under the constraints of the problem; V + c stays a sum of
squares. Without windows every entry of q is reduced by up to a tenth, all entries by the same share if P is singular,
so that a bounded problem stays bounded. The parent judges some of the answers when the calls are over, against optima
that are proven then: those that come first in a secret permutation of the calls, which all solvers share. A solver that
made fewer calls than others is judged on the first of those that it made.
"""

import math
from collections.abc import Iterator, Sequence
from functools import cache, cached_property

import numpy as np
from qpsolvers import Problem

from bench.problems.protocol import CertifiedForm, Window
from solvers.arrays import Matrix, Vector, product
from solvers.certificate import NotCertified, certify

LEAST = 0.9
"""Smallest factor of q for a problem without windows."""


def mixed(form: CertifiedForm, shares: Matrix, factors: Matrix) -> tuple[Matrix, Matrix]:
    """P (n, d, d) and q (n, d) of n mixtures of a problem and its windows, with shares (n, 1 + windows) and factors of
    q (n, d) or (n, 1); P is exactly symmetric if the problem's is."""
    dense = form.qp.P if isinstance(form.qp.P, np.ndarray) else form.qp.P.toarray()  # update takes dense data
    P, q = np.zeros((len(shares), *dense.shape)), np.zeros((len(shares), form.qp.q.size))
    for share, part in zip(shares.T, (Window(dense, form.qp.q, form.c), *form.windows), strict=True):
        P += share[:, None, None] * part.P
        q += share[:, None] * part.q
    return P, q * factors


def mixture(form: CertifiedForm, shares: Vector, factors: Vector) -> CertifiedForm:
    """One mixture with its certified optimum; NotCertified if there is no proof."""
    (P,), (q,) = mixed(form, shares[None], factors[None])
    qp, c = form.qp, float(product(np.array([[form.c, *(window.c for window in form.windows)]]), shares)[0])
    program = Problem(P, q, qp.G, qp.h, qp.A, qp.b, qp.lb, qp.ub)
    proof = certify(program, np.array(form.certificate.x))
    return CertifiedForm(program, c, form.to_weights, proof, cost_unit=form.cost_unit)


def proven_mixture(form: CertifiedForm, shares: Vector, factors: Vector) -> CertifiedForm | None:
    """One mixture with its certified optimum; None if there is no proof, and so an answer to it is not judged."""
    try:
        return mixture(form, shares, factors)
    except NotCertified:
        return None


class FreshData:
    """Mixtures that only the process that draws them knows.

    Parameters
    ----------
    form : CertifiedForm
    count : int
        Number of calls whose answers may be judged.
    seed : int or sequence of int, optional
        Random by default.
    """

    def __init__(self, form: CertifiedForm, count: int, seed: int | Sequence[int] | None = None) -> None:
        self._form, self.count = form, count
        self._generator = np.random.default_rng(seed)
        self._factors_of_q = 0 if form.windows else form.qp.q.size if math.isfinite(form.condition) else 1
        self._shares, self._factors = self._drawn(count)
        self._permutation = self._generator.permutation(count)
        self.certified = cache(lambda call: proven_mixture(form, *self.draw(call)))
        """The program of a call with its certified optimum; None if it cannot be proven."""

    def judged(self, made: int, few: int) -> Iterator[tuple[int, CertifiedForm]]:
        """At most ``few`` of the first ``made`` calls, drawn in secret, each with its program and certified optimum;
        without those whose optimum cannot be proven."""
        calls = self._permutation[self._permutation < made][:few]
        return ((int(call), form) for call in calls if (form := self.certified(int(call))) is not None)

    def draw(self, call: int) -> tuple[Vector, Vector]:
        """Shares and factors of a call, as of :func:`mixture`."""
        return self._shares[call], self._factors[call]

    def block(self, first: int, last: int) -> tuple[Matrix, Matrix]:
        """P (n, d, d) and q (n, d) of calls ``first`` to ``last`` − 1."""
        return mixed(self._form, self._shares[first:last], self._factors[first:last])

    def unseen(self, count: int) -> tuple[Matrix, Matrix]:
        """``count`` new P and q; their answers are not judged."""
        return mixed(self._form, *self._drawn(count))

    def _drawn(self, count: int) -> tuple[Matrix, Matrix]:
        """Random shares of the windows, and factors of q."""
        factors = (
            self._generator.uniform(LEAST, 1.0, (count, self._factors_of_q))
            if self._factors_of_q
            else np.ones((count, 1))
        )
        return self._generator.dirichlet(np.ones(1 + len(self._form.windows)), size=count), factors

    @cached_property
    def calls_at_once(self) -> int:
        """Number of calls that fit into a message of a megabyte."""
        return max(1, 2**17 // self._form.qp.q.size**2)
