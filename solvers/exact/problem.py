"""A quadratic program in doubles as an exact program.

    minimise V(x) = ½ xᵀ(P + δI) x + qᵀx   subject to   G x ≤ h,  A x = b,  lb ≤ x ≤ ub

P means its symmetric part (P + Pᵀ)/2, which has the same cost. Rounding can make a Gram matrix indefinite, by
about 1e-16 of its trace, hence this rule for the shift δ:

- δ = 0 if P is positive semidefinite;
- otherwise δ is the smallest power of two, not below 2^-1074, with P + δI ⪰ 0;
- if that exceeds 1e-12 · trace(P)/d, the problem is refused as not convex.

A shift changes the cost of x by ½ δ‖x‖².
"""

from __future__ import annotations

import hashlib
import math
from bisect import bisect_left
from functools import cached_property, lru_cache

import numpy as np
from flint import fmpq, fmpz

from solvers.exact.linear_algebra import (
    WORK,
    IntegerRows,
    NotCertified,
    Rational,
    Work,
    column,
    integers,
    semidefinite_rank,
)
from solvers.exact.program import Constraint, ExactProgram, Kind
from solvers.protocol import Vector
from solvers.rows import Arrays

SHIFT_LIMIT = 1e-12
"""Largest accepted shift, in units of trace(P)/d."""
NEAR = 1e-6
"""Relative slack below which a row is guessed active; a wrong guess costs pivots only."""


class DoubleProblem(Arrays):
    """A problem in doubles; problems are equal if their fingerprints are."""

    def __eq__(self, other: object) -> bool:
        """Whether the data are the same."""
        return isinstance(other, DoubleProblem) and self.fingerprint == other.fingerprint

    def __hash__(self) -> int:
        """Hash of the fingerprint."""
        return hash(self.fingerprint)

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of all data."""
        digest = hashlib.sha256()
        for array in (self.P, self.q, self.G, self.h, self.A, self.b, self.lb, self.ub):
            digest.update(str(array.shape).encode() + np.ascontiguousarray(array + 0.0).tobytes())  # −0 becomes +0
        return digest.hexdigest()

    @cached_property
    def _symmetric(self) -> tuple[IntegerRows, int]:
        """(P + Pᵀ)/2 as integers times a power of two."""
        d = self.q.size
        flat, exponent = integers(self.P)
        return [[flat[i * d + j] + flat[j * d + i] for j in range(d)] for i in range(d)], exponent - 1

    def constraints(self) -> tuple[Constraint, ...]:
        """Every finite constraint: equalities, rows of G, lower bounds, upper bounds."""
        constraints = []
        for kind, M, right in ((Kind.EQUALITY, self.A, self.b), (Kind.ROW, self.G, self.h)):
            present = np.flatnonzero(np.isfinite(right)).tolist()
            flat, width = integers(np.column_stack([M[present], right[present]]))[0], M.shape[1] + 1
            for i, start in zip(present, range(0, len(flat), width), strict=True):
                *a, b = flat[start : start + width]
                constraints.append(Constraint(kind, i, fmpq(b), tuple(a)))
        for kind, bound, sign in ((Kind.LOWER, self.lb, -1), (Kind.UPPER, self.ub, 1)):
            constraints += [
                Constraint(kind, i, sign * fmpq(*bound[i].as_integer_ratio()))
                for i in np.flatnonzero(np.isfinite(bound)).tolist()
            ]
        return tuple(constraints)

    def _is_plainly_definite(self) -> bool:
        """Whether a Cholesky factorisation in doubles proves P ≻ 0; if it does not, P may still be positive definite.

        A is P scaled exactly, by powers of two, to a diagonal in [1, 4), and t = trace(A). If the factorisation of
        A − cI succeeds, its factor is that of A − cI + E with ‖E‖ ≤ γ_{d+1}/(1 − γ_{d+1}) t, γ_k = ku/(1 − ku), and the
        subtraction rounds by less than 4u. So with c = 4(d + 4) u t, A is positive definite (S. M. Rump, "Verification
        of positive definiteness", BIT 46, 2006; Higham, *Accuracy and Stability of Numerical Algorithms*, 2nd edition,
        theorem 10.3).
        """
        diagonal = np.diag(self.P)
        if not (self.P == self.P.T).all() or not (diagonal > 0.0).all():
            return False
        exponents = -((np.frexp(diagonal)[1] - 1) // 2)
        A = np.ldexp(self.P, exponents[:, None] + exponents)
        # an element has underflowed
        if not np.array_equal(np.ldexp(A, -exponents[:, None] - exponents), self.P):
            return False
        d = len(A)
        A[np.diag_indices(d)] -= 4 * (d + 4) * 2.0**-53 * float(np.trace(A))
        try:
            np.linalg.cholesky(A)
        except np.linalg.LinAlgError:
            return False
        return True

    def convexity_shift(self, work: Work | None = None) -> tuple[float, bool]:
        """δ by the rule of this module and whether P + δI is positive definite; raises NotCertified if it is
        refused."""
        d = self.q.size
        if self._is_plainly_definite():
            return 0.0, True
        P, exponent = self._symmetric
        work = work or Work(WORK)
        rank = semidefinite_rank(P, work)
        if rank is not None:
            return 0.0, rank == d

        def rank_at(power: int) -> int | None:
            return semidefinite_rank(_shifted(P, exponent, math.ldexp(1.0, power))[0], work)

        limit = SHIFT_LIMIT * (math.fsum(np.diag(self.P)) / d)
        powers = range(-1074, math.frexp(limit)[1])
        if limit <= 0 or rank_at(powers[-1]) is None:
            raise NotCertified(f"P is not convex: no shift up to {SHIFT_LIMIT:g}·trace(P)/d = {limit:.3g} makes it so")
        power = powers[bisect_left(powers, True, key=lambda power: rank_at(power) is not None)]
        return math.ldexp(1.0, power), rank_at(power) == d

    def guess(self, x: Vector) -> list[tuple[Kind, int]]:
        """A guess of the active set from an answer in doubles.

        A bound is guessed active if one Newton step in its variable alone, x_i − r_i/P_ii, would reach it; r is the
        gradient plus the rows near x times their multipliers, a least-squares fit on the variables away from bounds.
        """
        with np.errstate(all="ignore"):
            r = self.P @ x + self.q
            slack = self.h - self.G @ x
            near = np.flatnonzero(slack <= NEAR * (np.abs(self.G) @ np.abs(x) + np.abs(self.h)) * np.isfinite(self.h))
            rows = np.vstack([self.A, self.G[near]])
            free = (x - self.lb > NEAR * np.abs(x)) & (self.ub - x > NEAR * np.abs(x))
            if rows.size and free.any() and np.isfinite(r).all():
                multipliers = np.linalg.lstsq(rows[:, free].T, -r[free])[0]
                r = r + rows.T @ multipliers
                near = near[multipliers[self.b.size :] > 0]
            step = np.where(r == 0, 0.0, r / np.maximum(np.diag(self.P), 0.0))
            lower = np.flatnonzero((x - step <= self.lb) & np.isfinite(self.lb))
            upper = np.flatnonzero((x - step >= self.ub) & np.isfinite(self.ub))
        active = ((Kind.LOWER, lower), (Kind.UPPER, upper), (Kind.ROW, near[np.argsort(slack[near], kind="stable")]))
        return [(kind, i) for kind, which in active for i in which.tolist()]


@lru_cache(maxsize=128)
def exact(data: DoubleProblem, shift: float) -> tuple[ExactProgram, Rational]:
    """The exact program with P + shift·I, and the factor by which its cost is multiplied to give V.

    It is cached, since many answers are judged on few programs and the conversion takes longer than the judgement.
    """
    P, exponent = _shifted(*data._symmetric, shift)
    factor = fmpq(2) ** exponent
    return ExactProgram(P, column(data.q) / factor, data.constraints()), factor


def _shifted(P: IntegerRows, exponent: int, shift: float) -> tuple[IntegerRows, int]:
    """P + shift·I for a shift that is zero or a power of two, as integers times a power of two."""
    if shift == 0:
        return P, exponent
    power = math.frexp(shift)[1] - 1
    common = min(exponent, power)
    P = [[entry << (exponent - common) for entry in row] for row in P]
    for i, row in enumerate(P):
        row[i] += fmpz(1) << (power - common)
    return P, common
