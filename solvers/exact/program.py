"""A convex quadratic program in rationals, and the linear system of its optimality conditions.

    minimise ½ xᵀP x + qᵀx   subject to   aₖᵀx ≤ bₖ (inequalities),  aₖᵀx = bₖ (equalities)

For a working set W of constraints held as equations, with rows C and right-hand side b_W, the optimality system is

    [P  Cᵀ] [x]   [−q ]
    [C  0 ] [λ] = [b_W]

It is regular if and only if the rows of C are independent and no direction p ≠ 0 has P p = 0 and C p = 0 (Nocedal,
Wright, *Numerical Optimization*, 2nd edition, section 16.1).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

from flint import fmpq, fmpq_mat, fmpz, fmpz_mat

from solvers.exact.linear_algebra import (
    IntegerRows,
    NotCertified,
    Rational,
    RationalColumn,
    first_independent,
    rational_column,
)


class Infeasible(NotCertified):
    """The constraints contradict each other."""


class Unbounded(NotCertified):
    """The cost decreases without bound along a direction that no constraint blocks; the feasible set may be empty."""


class RoundingDecides(NotCertified):
    """P is indefinite by rounding, and the optimum depends on the shift that makes it convex."""


class Kind(StrEnum):
    """Kind of a constraint in the original problem; the value is its name in messages."""

    EQUALITY = "equality row"
    LOWER = "lower bound of variable"
    UPPER = "upper bound of variable"
    ROW = "inequality row"
    PIN = "pinned variable"
    """x_i = 0 for a variable that neither the cost nor a constraint determines; not a constraint of the problem."""


@dataclass(frozen=True)
class Constraint:
    """aᵀx ≤ b, or aᵀx = b for an equality and a pin, with integer a; a bound is ±x_i ≤ b and has no ``a``."""

    kind: Kind
    index: int
    b: Rational
    a: tuple[Rational, ...] | None = None

    @property
    def sign(self) -> int:
        """The coefficient of a bound's variable."""
        return -1 if self.kind is Kind.LOWER else 1

    @property
    def size(self) -> Rational:
        """The largest coefficient (1 for a row of zeros), by which slacks of different rows are compared."""
        return fmpz(1) if self.a is None else max(abs(entry) for entry in self.a) or fmpz(1)

    def broken_by(self, slack: Rational) -> bool:
        """Whether a point with the slack b − aᵀx violates this constraint."""
        return bool(slack < 0 or (slack != 0 and self.kind is Kind.EQUALITY))

    def refuses(self, multiplier: Rational) -> bool:
        """Whether a multiplier has the wrong sign: negative for an inequality, other than 0 for a pin."""
        return bool((multiplier < 0 and self.kind is not Kind.EQUALITY) or (multiplier != 0 and self.kind is Kind.PIN))

    def __str__(self) -> str:
        """Its name in messages."""
        return f"{self.kind.value} {self.index}"

    def row(self, d: int) -> list[Rational]:
        """The coefficients, shape (d,)."""
        if self.a is not None:
            return list(self.a)
        return [fmpz(self.sign if i == self.index else 0) for i in range(d)]


@dataclass(frozen=True)
class ExactProgram:
    """A quadratic program; a positive factor of the cost is left out.

    Parameters
    ----------
    P : list of list of fmpz, shape (d, d)
        Symmetric positive semidefinite; the caller proves it (:func:`solvers.exact.linear_algebra.semidefinite_rank`).
    q : fmpq_mat, shape (d, 1)
    constraints : tuple of Constraint
        A constraint is identified by its position. The program itself adds the pins after these.
    """

    P: IntegerRows
    q: RationalColumn
    constraints: tuple[Constraint, ...]

    @property
    def d(self) -> int:
        """Number of variables."""
        return len(self.P)

    @cached_property
    def hessian(self) -> RationalColumn:
        """P as a rational matrix (d, d)."""
        return fmpq_mat(fmpz_mat(self.P))

    def constraint(self, k: int) -> Constraint:
        """The constraint at position k; positions from ``len(constraints)`` on are the pins."""
        known = len(self.constraints)
        return self.constraints[k] if k < known else Constraint(Kind.PIN, k - known, fmpq(0))

    @cached_property
    def positions(self) -> dict[tuple[Kind, int], int]:
        """Position of the constraint of a kind and an index."""
        return {(c.kind, c.index): k for k, c in enumerate(map(self.constraint, range(len(self.constraints) + self.d)))}

    @cached_property
    def general(self) -> tuple[list[int], RationalColumn]:
        """Positions and coefficients (m, d) of the constraints that are not bounds."""
        rows = {k: c.a for k, c in enumerate(self.constraints) if c.a is not None}
        return list(rows), fmpq_mat(len(rows), self.d, [entry for a in rows.values() for entry in a])

    @cached_property
    def regular(self) -> bool:
        """Whether P is known to be regular, since it is regular modulo a prime."""
        return len(first_independent(self.P)) == self.d

    @cached_property
    def bits(self) -> int:
        """Bits of the longest coefficient."""
        return max(
            (
                int(entry).bit_length()
                for row in (*self.P, *(c.a for c in self.constraints if c.a is not None))
                for entry in row
            ),
            default=0,
        )

    def pivot_work(self, W: Sequence[int]) -> float:
        """Work of solving the system of a working set: its dimension cubed times the bits of its entries."""
        rows = sum(self.constraint(k).a is not None for k in W)
        size = self.d - (len(W) - rows) + rows
        return float(size) ** 3 * self.bits

    def along(self, x: RationalColumn) -> list[Rational]:
        """aₖᵀx of every constraint; one matrix product for all general rows, since a call is slow."""
        positions, matrix = self.general
        products = dict(zip(positions, (matrix * x).entries(), strict=True))
        return [products[k] if c.a is not None else c.sign * x[c.index, 0] for k, c in enumerate(self.constraints)]

    def value(self, x: RationalColumn) -> Rational:
        """½ xᵀP x + qᵀx."""
        return (x.transpose() * (self.hessian * x * fmpq(1, 2) + self.q))[0, 0]

    def violated(self, x: RationalColumn) -> list[int]:
        """Positions of the constraints that x violates."""
        return [k for k, ax in enumerate(self.along(x)) if self.constraints[k].broken_by(self.constraints[k].b - ax)]

    def working_set(self, candidates: Iterable[int]) -> list[int]:
        """Some candidates, reduced and completed so that their optimality system is regular.

        Equalities come first, then the candidates in order; a constraint that depends on those before it is left out.
        If P is singular on the remaining subspace, other constraints and finally pins are added until it is not.
        """
        equalities = [k for k, c in enumerate(self.constraints) if c.kind is Kind.EQUALITY]
        first = list(dict.fromkeys([*equalities, *candidates]))
        first = [first[i] for i in first_independent([self.constraint(k).row(self.d) for k in first])]
        if self.regular:
            return first
        order = list(dict.fromkeys([*first, *range(len(self.constraints) + self.d)]))
        independent = first_independent(self.P + [self.constraint(k).row(self.d) for k in order])
        return first + [order[i - self.d] for i in independent if i >= self.d + len(first)]

    def kkt_solve(
        self, W: Sequence[int], f: RationalColumn, g: Sequence[Rational]
    ) -> tuple[RationalColumn, dict[int, Rational]]:
        """Solve P p + Cᵀu = f, C p = g; returns p (d, 1) and u by position.

        Bounds and pins in W fix their variables, so that only the others and the general rows enter the linear system.
        Raises ZeroDivisionError if the system is singular.
        """
        d, right = self.d, dict(zip(W, g, strict=True))
        bounds = {k: c for k in W if (c := self.constraint(k)).a is None}
        rows = {k: list(c.a) for k in W if (c := self.constraint(k)).a is not None}
        fixed = {c.index for c in bounds.values()}
        if len(fixed) < len(bounds):
            raise ZeroDivisionError("one variable is fixed twice")
        free = [i for i in range(d) if i not in fixed]
        p = fmpq_mat(d, 1)
        for k, c in bounds.items():
            p[c.index, 0] = c.sign * right[k]
        residual = f - self.hessian * p
        u = dict.fromkeys(W, fmpq(0))
        if free or rows:
            K = [[self.P[i][j] for j in free] + [a[i] for a in rows.values()] for i in free]
            K += [[a[j] for j in free] + [fmpz(0)] * len(rows) for a in rows.values()]
            rhs = [residual[i, 0] for i in free]
            if rows:
                along_p = self.along(p)
                rhs += [right[k] - along_p[k] for k in rows]
            answer = fmpq_mat(fmpz_mat(K)).solve(rational_column(rhs))
            for position, i in enumerate(free):
                p[i, 0] = answer[position, 0]
            u.update({k: answer[len(free) + position, 0] for position, k in enumerate(rows)})
        Pp = self.hessian * p
        for k, c in bounds.items():
            i = c.index
            u[k] = c.sign * (f[i, 0] - Pp[i, 0] - sum((a[i] * u[r] for r, a in rows.items()), fmpq(0)))
        return p, u


@dataclass(frozen=True)
class Point:
    """The stationary point of a working set and its violated conditions."""

    x: RationalColumn
    multipliers: dict[int, Rational]
    """λ by position, of the constraints in the working set."""
    slacks: dict[int, Rational]
    """bₖ − aₖᵀx by position, of the constraints outside."""
    wrong: list[int]
    """Positions, ascending: violated outside the working set, or of the wrong sign inside."""


def stationary_point(program: ExactProgram, W: Sequence[int]) -> Point:
    """Solve the optimality system of W; raises ZeroDivisionError if it is singular."""
    x, multipliers = program.kkt_solve(W, -program.q, [program.constraint(k).b for k in W])
    slacks = {k: program.constraint(k).b - ax for k, ax in enumerate(program.along(x)) if k not in multipliers}
    wrong = [k for k, slack in slacks.items() if program.constraint(k).broken_by(slack)]
    wrong += [k for k, multiplier in multipliers.items() if program.constraint(k).refuses(multiplier)]
    return Point(x, multipliers, slacks, sorted(wrong))
