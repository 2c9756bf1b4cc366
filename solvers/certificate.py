"""The certified optimum of a convex quadratic program, and the exact distance in cost of any answer from it.

    minimise V(x) = ½ xᵀ(P + δI) x + qᵀx   subject to   G x ≤ h,  A x = b,  lb ≤ x ≤ ub

The data are doubles, hence rationals, and everything here is computed in rationals. A proof has seven lines, which
:func:`verify` replays from the data and the stored ingredients alone:

1. problem: the data are those that the certificate was made for (SHA-256).
2. convexity: P + δI ⪰ 0, with the δ of the rule in :mod:`solvers.exact.problem`; δ = 0 almost always. Otherwise the
   optimum must not depend on δ: ½ δ‖x*‖² ≤ 1e-12 (½ |x*ᵀP x*| + |qᵀx*|).
3. stationarity: the optimality system of the stored active set is regular; its solution is x*, λ*.
4. feasibility: x* breaks no constraint.
5. signs: no inequality has a negative multiplier. With 2 to 4 these are the KKT conditions, and any KKT point of a
   convex program is optimal (Boyd, Vandenberghe, *Convex Optimization*, 2004, section 5.5.3).
6. value: V(x*) equals the stored rational. It is the only optimal value even if x* is not the only optimum.
7. answer: the stored doubles are x* and V(x*) rounded, and the stored statement on uniqueness, if any, is right.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import msgspec
import numpy as np
from flint import fmpq
from qpsolvers import Problem

from solvers.checks import finite
from solvers.exact.active_set import nearest_feasible_point, optimum, uniqueness
from solvers.exact.linear_algebra import (
    WORK,
    NotCertified,
    Rational,
    RationalColumn,
    Work,
    column,
    nearest_double,
)
from solvers.exact.problem import DoubleProblem, exact
from solvers.exact.program import (
    ExactProgram,
    Infeasible,
    Kind,
    Point,
    RoundingDecides,
    Unbounded,
    stationary_point,
)
from solvers.protocol import Vector

__all__ = [
    "WORK",
    "Certificate",
    "Gap",
    "Infeasible",
    "NotCertified",
    "RoundingDecides",
    "Unbounded",
    "certify",
    "exact_cost_gap",
    "verify",
]

SHIFT_SHARE = fmpq(1, 10**12)
"""Largest share of the shift in the cost: the finest accuracy by which answers are judged."""


WORKING_SET = {
    Kind.LOWER: "lower",
    Kind.UPPER: "upper",
    Kind.ROW: "rows",
    Kind.EQUALITY: "equalities",
    Kind.PIN: "pinned",
}
"""The fields of a certificate that contain its working set."""
Index = Annotated[int, msgspec.Meta(ge=0)]


@dataclass(frozen=True)
class Certificate:
    """The ingredients of the proof."""

    problem: str
    """SHA-256 of the data."""
    lower: tuple[Index, ...]
    upper: tuple[Index, ...]
    rows: tuple[Index, ...]
    equalities: tuple[Index, ...]
    pinned: tuple[Index, ...]
    """The working set: variables at their bounds, active rows of G, independent rows of A, and undetermined variables,
    which are set to zero."""
    convexity_shift: float
    """δ."""
    unique: bool | None
    """Whether x* is the only optimum (of the shifted problem); None if that was not decided."""
    x: tuple[float, ...]
    """x* rounded to double; :func:`solvers.certificate_document.document` gives it exactly."""
    value: Annotated[str, msgspec.Meta(pattern=r"^-?[0-9]+(/[1-9][0-9]*)?$")]
    """V(x*) as "p/q" in lowest terms."""
    value_rounded: float
    """V(x*) rounded to double."""

    def to_json(self) -> str:
        """One JSON object; doubles survive the round trip bit by bit."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Certificate:
        """The inverse of :meth:`to_json`; raises ValueError for anything else."""
        try:
            return msgspec.json.decode(text, type=cls)
        except (ValueError, RecursionError) as error:
            raise ValueError(f"this is not a certificate: {error}") from None

    def active(self) -> list[tuple[Kind, int]]:
        """The working set by name."""
        return [(kind, i) for kind, field in WORKING_SET.items() for i in getattr(self, field)]


@dataclass(frozen=True)
class Gap:
    """How far an answer x is from the optimum."""

    absolute: float
    """V(x̂) − V* ≥ 0, exact and rounded once, where x̂ is the feasible point nearest to x."""
    relative: float
    """absolute / max(|V* + c|, 2^-52 |c|, smallest normal double). With c = ½Σx² the sum V + c is a sum of squared
    errors; below 2^-52 |c| the sum V* + c is nothing but the rounding of c."""
    violation: float
    """‖x − x̂‖∞, reported apart because an infeasible x can cost less than V*."""


def certify(problem: Problem, x: Vector, *, work: float = WORK) -> Certificate:
    """Prove the optimum of a problem, starting from any answer.

    Parameters
    ----------
    problem : qpsolvers.Problem
        d variables; finite doubles, bounds and h may be infinite on their open side.
    x : array, shape (d,)
        A solver's answer. The better it is, the fewer exact pivots are needed; the proof does not depend on it.
    work : float
        Limit of the work in bit operations, see :meth:`solvers.exact.program.ExactProgram.pivot_work`. As much again
        may be spent on whether the optimum is unique, which may remain undecided.

    Raises
    ------
    NotCertified
        The problem is not convex, infeasible (:class:`Infeasible`), unbounded (:class:`Unbounded`), takes too much
        work, or has an optimum by the shift alone (:class:`RoundingDecides`).
    ValueError
        NaN or an infinity in the data or in x, or a wrong shape.

    Examples
    --------
    >>> problem = Problem(np.eye(2), np.array([-3.0, 1.0]), lb=np.zeros(2), ub=np.full(2, 2.0))
    >>> proof = certify(problem, np.array([1.9, 0.1]))
    >>> proof.x, proof.value, proof.lower, proof.upper, proof.unique
    ((2.0, 0.0), '-4', (1,), (0,), True)
    """
    data = DoubleProblem(problem)
    x = finite("x", x, data.q.shape)
    budget = Work(work)
    shift, definite = data.convexity_shift(budget)
    budget.known = "P is convex, and no active set has been tried"
    program, factor = exact(data, shift)
    try:
        W, point = optimum(program, [program.positions[name] for name in data.guess(x)], budget)
    except Unbounded:
        # an empty feasible set can show a ray too: then this raises Infeasible
        nearest_feasible_point(program, column(x), budget)
        raise
    _check_shift(program, factor, shift, point.x)
    names = [program.constraint(k) for k in W]
    sets: dict[str, Any] = {
        field: tuple(sorted(c.index for c in names if c.kind is kind)) for kind, field in WORKING_SET.items()
    }
    value = program.value(point.x) * factor
    return Certificate(
        problem=data.fingerprint,
        **sets,
        convexity_shift=shift,
        unique=definite or uniqueness(program, point, Work(work))[0],
        x=_rounded(point.x),
        value=str(value),
        value_rounded=nearest_double(value),
    )


def _check_shift(program: ExactProgram, factor: Rational, shift: float, x: RationalColumn) -> None:
    """The second half of line 2: raises if the share of the shift in the cost exceeds SHIFT_SHARE.

    Such an optimum lies far out in a direction in which the curvature of P is below its rounding error. Only δ bounds x
    there; with P rounded differently, the program has no minimum or one elsewhere. The exact solvers call such programs
    unbounded.
    """
    if shift == 0.0:
        return
    shift_term = fmpq(*shift.as_integer_ratio()) * (x.transpose() * x)[0, 0] / 2
    linear = (x.transpose() * program.q)[0, 0] * factor
    if shift_term > SHIFT_SHARE * (abs(program.value(x) * factor - linear - shift_term) + abs(linear)):
        raise RoundingDecides(
            f"P is indefinite by rounding, and only the shift of {shift:.1e} that makes it convex stops the cost from "
            "falling in a direction without curvature"
        )


def _rounded(x: RationalColumn) -> tuple[float, ...]:
    return tuple(nearest_double(entry) for entry in x.entries())


def stored_point(program: ExactProgram, certificate: Certificate) -> Point:
    """The stationary point of the stored active set; raises NotCertified where line 3 of the proof fails."""
    active = certificate.active()
    for kind, i in active:
        if (kind, i) not in program.positions:
            raise NotCertified(f"proof line 3 (stationarity) fails: the problem has no {kind.value} {i}")
    if len(set(active)) < len(active):
        raise NotCertified("proof line 3 (stationarity) fails: the active set names a constraint twice")
    try:
        return stationary_point(program, [program.positions[name] for name in active])
    except ZeroDivisionError as error:
        raise NotCertified("proof line 3 (stationarity) fails: the system of the active set is singular") from error


def verify(problem: Problem, certificate: Certificate) -> None:
    """Replay the proof; raises :class:`NotCertified`, which names the first line that fails."""

    def line(name: str, holds: bool, why: str) -> None:
        if not holds:
            raise NotCertified(f"proof line {name} fails: {why}")

    data = DoubleProblem(problem)
    line("1 (problem)", certificate.problem == data.fingerprint, "the certificate belongs to other data")
    shift, definite = data.convexity_shift()
    line("2 (convexity)", certificate.convexity_shift == shift, f"the rule gives the shift {shift!r}")
    program, factor = exact(data, shift)
    point = stored_point(program, certificate)
    for k in point.wrong:
        line("4 (feasibility)", k in point.multipliers, f"x* breaks the {program.constraint(k)}")
    for k in point.wrong:
        line("5 (signs)", False, f"the multiplier of the {program.constraint(k)} has the wrong sign")
    _check_shift(program, factor, shift, point.x)
    value = program.value(point.x) * factor
    line("6 (value)", certificate.value == str(value), f"the value is another, near {nearest_double(value)!r}")
    line("7 (answer)", certificate.value_rounded == nearest_double(value), "value_rounded is not the value rounded")
    line("7 (answer)", certificate.x == _rounded(point.x), "x is not x* rounded")
    if certificate.unique is not None:
        unique = definite or uniqueness(program, point, Work(math.inf))[0]
        line("7 (answer)", certificate.unique == unique, f"the optimum is {'' if unique else 'not '}unique")


def exact_cost_gap(problem: Problem, certificate: Certificate, x: Vector, c: float = 0.0) -> Gap:
    """The exact cost of an answer above the certified optimum.

    Parameters
    ----------
    problem : qpsolvers.Problem
    certificate : Certificate
        Of this problem; its value is not checked again (:func:`verify` does).
    x : array, shape (d,)
        The answer. It is replaced by the nearest feasible point x̂: by clipping if there are bounds only, else by the
        exact Euclidean projection, a quadratic program with P = I that the same rational pivots solve.
    c : float
        Constant term of the problem, in the units of V.

    Raises
    ------
    NotCertified
        The certificate is of another problem, or the gap is negative, which disproves it.
    ValueError
        NaN or an infinity in x or c, or a wrong shape.

    Examples
    --------
    >>> problem = Problem(np.eye(2), np.array([-3.0, 1.0]), lb=np.zeros(2), ub=np.full(2, 2.0))
    >>> exact_cost_gap(problem, certify(problem, np.zeros(2)), np.array([1.5, -0.25]), c=5.0)
    Gap(absolute=0.625, relative=0.625, violation=0.25)
    """
    data = DoubleProblem(problem)
    x = finite("x", x, data.q.shape)
    if not math.isfinite(c):
        raise ValueError(f"the constant term c must be finite, not {c}")
    if certificate.problem != data.fingerprint:
        raise NotCertified("proof line 1 (problem) fails: the certificate belongs to other data")
    program, factor = exact(data, certificate.convexity_shift)
    answer = column(x)
    if not (data.h.size or data.b.size):
        feasible = column(np.clip(x, data.lb, data.ub))
    else:
        feasible = nearest_feasible_point(program, answer)[1].x if program.violated(answer) else answer
    best, constant = fmpq(certificate.value), fmpq(*float(c).as_integer_ratio())
    gap = program.value(feasible) * factor - best
    if gap < 0:
        raise NotCertified(f"a feasible point costs {nearest_double(-gap):.3g} less than the certified optimum")
    scale = max(abs(best + constant), abs(constant) * fmpq(2) ** -52, fmpq(2) ** -1022)
    moved = max(abs(entry) for entry in (answer - feasible).entries())
    return Gap(nearest_double(gap), nearest_double(gap / scale), nearest_double(moved))
