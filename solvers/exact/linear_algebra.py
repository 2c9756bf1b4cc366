"""Linear algebra on doubles without rounding, or with rounding errors enclosed.

A finite double is an integer times a power of two, so a matrix of doubles is one integer matrix times one power of two.
Three problems with such matrices are solved here, each with a proof:

- ``A x = b`` by FLINT's p-adic lifting: J. D. Dixon, "Exact solution of linear equations using p-adic expansions",
  Numer. Math. 40 (1982), reached as ``fmpq_mat.solve``;
- ``P ⪰ 0`` by an LDLᵀ with diagonal pivoting whose entries are balls that contain the true value (F. Johansson, "Arb:
  efficient arbitrary-precision midpoint-radius interval arithmetic", IEEE Trans. Comput. 66, 2017), together with the
  exact rank: r positive pivots of a matrix of rank r leave a Schur complement of rank 0, which is zero;
- selection of independent rows modulo a prime: rows that are independent modulo a prime are independent.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from flint import arb, ctx, fmpq, fmpq_mat, fmpz, fmpz_mat, nmod_mat
from numpy.typing import NDArray

# FLINT has no type stubs; these names stand for its types.
Rational = Any
RationalColumn = Any
IntegerRows = list[list[Any]]

PRIME = 2**63 - 25
"""Largest prime below 2**63."""


WORK = 5e10
"""Default limit of the work of a proof: about a minute on a machine of 2025."""


class NotCertified(Exception):
    """No proof of an optimum exists, or the proof at hand is wrong; the message is one sentence with the reason."""


class OutOfWork(NotCertified):
    """The limit of the work is exceeded; the message says what had been found out by then."""


class Work:
    """A limit on the work of a proof, in bit operations instead of seconds, so that results do not depend on the load
    of the machine."""

    def __init__(self, limit: float) -> None:
        self._limit = self._remaining = limit
        self.known = "convexity is undecided"
        """What is known so far, for the message of :class:`OutOfWork`."""

    def spend(self, amount: float) -> None:
        """Subtract an amount; OutOfWork if it exceeds the remainder."""
        self._remaining -= amount
        if self._remaining < 0.0:
            raise OutOfWork(f"no proof within {self._limit:.0e} bit operations of exact arithmetic; {self.known}")


def integers(values: NDArray[np.float64]) -> tuple[list[Any], int]:
    """Finite doubles as flat integers n and one exponent e with ``values == n · 2**e`` exactly.

    Examples
    --------
    >>> integers(np.array([0.75, -3.0]))[1]
    -53
    """
    mantissa, exponent = np.frexp(np.ravel(values))
    nonzero = mantissa != 0
    lowest = int(exponent[nonzero].min()) if nonzero.any() else 0
    shifts = np.where(nonzero, exponent - lowest, 0).tolist()
    whole = np.ldexp(mantissa, 53).astype(np.int64).tolist()
    return [fmpz(n << shift) for n, shift in zip(whole, shifts, strict=True)], lowest - 53


def column(values: NDArray[np.float64]) -> RationalColumn:
    """Finite doubles (d,) as an exact rational column (d, 1)."""
    flat, exponent = integers(values)
    return fmpq_mat(fmpz_mat(len(flat), 1, flat)) * fmpq(2) ** exponent


def nearest_double(value: Rational) -> float:
    """A rational rounded once to double; infinite beyond the largest double."""
    try:
        # Python rounds a quotient of integers correctly, however long
        return float(int(value.numerator) / int(value.denominator))
    except OverflowError:
        return float("inf") if value > 0 else -float("inf")


def first_independent(rows: IntegerRows) -> list[int]:
    """Positions of the rows that are not a combination of rows before them, taken modulo :data:`PRIME`.

    The returned rows are independent over the rationals too. The others need not be dependent over the rationals, if
    the prime divides a minor; callers that need the converse must check it.
    """
    if not rows:
        return []
    columns = nmod_mat(fmpz_mat(rows).transpose(), PRIME)
    echelon, rank = columns.rref()
    positions, start = [], 0
    for i in range(rank):
        start = next(j for j in range(start, len(rows)) if int(echelon[i, j]) != 0)
        positions.append(start)
    return positions


def semidefinite_rank(P: IntegerRows, work: Work | None = None) -> int | None:
    """The rank of a symmetric matrix that is proved positive semidefinite; None if it is proved not to be.

    Parameters
    ----------
    P : list of list of fmpz, shape (d, d)
        Exactly symmetric.
    work : Work, optional
        Limit of the work, WORK by default.

    Notes
    -----
    While a ball contains zero, the precision is doubled. This terminates: a nonzero Schur complement has a diagonal
    entry or a 2 × 2 minor whose sign is found with enough bits.

    Examples
    --------
    >>> semidefinite_rank([[1, 1], [1, 1]]), semidefinite_rank([[0, 1], [1, 0]])
    (1, None)
    """
    d, rank = len(P), len(P)
    bits = 64 + 4 * d
    work = work or Work(WORK)
    pivots = _positive_pivots(P, bits, work)
    if pivots is not None and pivots < d:
        rank = int(fmpz_mat(P).rank())
    while pivots is not None and pivots < rank:
        bits *= 2
        pivots = _positive_pivots(P, bits, work)
    return pivots


def _positive_pivots(P: IntegerRows, bits: int, work: Work) -> int | None:
    """Number of pivots that are proved positive at this precision; None if the matrix is proved indefinite."""
    work.spend(float(len(P)) ** 3 * (bits / 8 + 64))
    with ctx.workprec(bits):
        S = [[arb(entry) for entry in row[: i + 1]] for i, row in enumerate(P)]  # lower triangle, overwritten
        alive = list(range(len(P)))
        while positive := [i for i in alive if S[i][i] > 0]:
            k = max(positive, key=lambda i: S[i][i].lower())
            alive.remove(k)
            pivot_column = [S[max(i, k)][min(i, k)] for i in alive]
            for count, i in enumerate(alive):
                factor, row = pivot_column[count] / S[k][k], S[i]
                for j, entry in zip(alive[: count + 1], pivot_column, strict=False):
                    row[j] -= factor * entry
        if any(S[i][i] < 0 or any(S[i][j] ** 2 > S[i][i] * S[j][j] for j in alive if j < i) for i in alive):
            return None
        return len(P) - len(alive)


def rational_column(entries: Sequence[Rational]) -> RationalColumn:
    """Rationals as a column (len(entries), 1)."""
    return fmpq_mat(len(entries), 1, list(entries))
