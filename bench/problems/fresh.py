"""Data that a solver cannot have seen: mixtures of neighbouring windows of a problem's recording.

    P = Σ θ_k P_k,   q = Σ θ_k q_k,   c = Σ θ_k c_k,    θ ≥ 0, Σ θ_k = 1

is the data basis of all windows with random weights, under the constraints of the problem; V + c stays a sum of
squares. Without windows P is fixed, and no solver is given it again; every entry of q is reduced by up to a tenth, all
entries by the same share if P is singular, so that a bounded problem stays bounded. The parent judges the answers when
the calls are over (`bench.races.metrics`). Where floating point does not decide, proofs are made of the calls that come
first in a secret permutation, which all solvers share.
"""

import math
import secrets
from contextlib import suppress
from functools import cache, cached_property

import numpy as np
from qpsolvers import Problem

import solvers
from bench.problems.gap_bounds import Bounds, gap_bounds, has_bounds_only, least_eigenvalues
from bench.problems.protocol import CertifiedForm, Window
from solvers.arrays import Index, Matrix, Vector, product
from solvers.certificate import NotCertified, certify
from solvers.protocol import Solver

LEAST = 0.9
"""Smallest factor of q for a problem without windows."""


def mixed(form: CertifiedForm, shares: Matrix, factors: Matrix) -> tuple[Matrix | None, Matrix]:
    """P (n, d, d) and q (n, d) of n mixtures of a problem and its windows, with shares (n, 1 + windows) and factors of
    q (n, d) or (n, 1); P is exactly symmetric if the problem's is, and None without windows, since it is the problem's.
    """
    if not form.windows:
        return None, form.qp.q * factors
    dense = form.qp.P if isinstance(form.qp.P, np.ndarray) else form.qp.P.toarray()  # update takes dense data
    P, q = np.zeros((len(shares), *dense.shape)), np.zeros((len(shares), form.qp.q.size))
    for share, window in zip(shares.T, (Window(dense, form.qp.q, form.c), *form.windows), strict=True):
        P += share[:, None, None] * window.P
        q += share[:, None] * window.q
    return P, q * factors


def mixture(form: CertifiedForm, shares: Vector, factors: Vector) -> CertifiedForm:
    """One mixture with its certified optimum; NotCertified if there is no proof."""
    P, (q,) = mixed(form, shares[None], factors[None])
    qp, c = form.qp, float(product(np.array([[form.c, *(window.c for window in form.windows)]]), shares)[0])
    program = Problem(qp.P if P is None else P[0], q, qp.G, qp.h, qp.A, qp.b, qp.lb, qp.ub)
    return CertifiedForm(
        program, c, form.to_weights, certify(program, np.array(form.certificate.x)), cost_unit=form.cost_unit
    )


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
    seed : int, optional
        Of all draws; secret by default.
    """

    def __init__(self, form: CertifiedForm, count: int, seed: int | None = None) -> None:
        self._form, self.count, self.seed = form, count, secrets.randbits(62) if seed is None else seed
        self._generator = np.random.default_rng(self.seed)
        self._factors_of_q = 0 if form.windows else form.qp.q.size if math.isfinite(form.condition) else 1
        self._shares, self._factors = self._drawn(count)
        self._permutation = self._generator.permutation(count)
        self.certified = cache(lambda call: proven_mixture(form, *self.draw(call)))
        """The program of a call with its certified optimum; None if it cannot be proven."""
        self._near_optima: dict[int, Vector] = {}

    def in_secret_order(self, calls: Index) -> list[int]:
        """Some calls, as they come in the permutation."""
        return [int(call) for call in self._permutation[np.isin(self._permutation, calls)]]

    def gap_bounds(self, calls: Index, answers: Matrix) -> Bounds:
        """Bounds of the larger of cost gap and violation of the answers (n, d) to these calls (n,), each (n,)."""
        low, high = np.zeros(len(answers)), np.full(len(answers), math.inf)
        for first in range(0, len(answers) if has_bounds_only(self._form) else 0, self.calls_at_once):
            batch = slice(first, first + self.calls_at_once)
            here, shares = calls[batch], self._shares[calls[batch]]
            P, q = mixed(self._form, shares, self._factors[here])
            near = np.array([self._near(int(call), P if P is None else P[i], q[i]) for i, call in enumerate(here)])
            c = shares @ [self._form.c, *(window.c for window in self._form.windows)]
            low[batch], high[batch] = gap_bounds(
                self._form, self._form.qp.P[None] if P is None else P, q, c, shares @ self._least, answers[batch], near
            )
        return low, high

    @cached_property
    def _least(self) -> Vector:
        return least_eigenvalues(self._form)

    def _near(self, call: int, P: Matrix | None, q: Vector) -> Vector:
        """A point within the bounds, near the optimum of a call; NaN if there is none."""
        if call not in self._near_optima:
            self._near_optima[call] = np.full(q.size, math.nan)
            with suppress(ValueError):  # it refuses a program that is not safely definite, which needs a proof
                self._solver.update(P=P, q=q)
                self._near_optima[call] = np.array(self._solver.solve())
        return self._near_optima[call]

    @cached_property
    def _solver(self) -> Solver:
        solver, qp = solvers.get("box_active_set"), self._form.qp
        solver.setup(Problem(qp.P, qp.q, lb=qp.lb, ub=qp.ub))
        return solver

    def draw(self, call: int) -> tuple[Vector, Vector]:
        """Shares and factors of a call, as of :func:`mixture`."""
        return self._shares[call], self._factors[call]

    def block(self, first: int, last: int) -> tuple[Matrix | None, Matrix]:
        """The data of calls ``first`` to ``last`` − 1, which may be more than ``count``."""
        if last > len(self._shares):
            self._shares, self._factors = map(
                np.vstack, zip((self._shares, self._factors), self._drawn(last - len(self._shares)), strict=True)
            )
            self._permutation = self._generator.permutation(last)
        return mixed(self._form, self._shares[first:last], self._factors[first:last])

    def _drawn(self, count: int) -> tuple[Matrix, Matrix]:
        """Random shares of the windows, and factors of q."""
        factors = (
            self._generator.uniform(LEAST, 1.0, (count, self._factors_of_q))
            if self._factors_of_q
            else np.ones((count, 1))
        )
        shares = self._generator.dirichlet(np.ones(1 + len(self._form.windows)), size=count)
        return shares if self._form.windows else np.ones((count, 1)), factors

    @cached_property
    def calls_at_once(self) -> int:
        """Number of calls that fit into a message of a megabyte."""
        return max(1, 2**17 // self._form.qp.q.size ** (2 if self._form.windows else 1))
