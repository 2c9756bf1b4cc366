"""A certificate as a document of numbers that anybody can check, without this package.

    P x* + δx* + q + Gᵀμ + Aᵀν − λ + κ = 0,   μ, λ, κ ≥ 0 and zero where their constraint is not tight

Doubles are written in hexadecimal and rationals as "p/q", so nothing is rounded. The document holds the data of the
program, the optimum x* with its multipliers μ, ν, λ, κ of the fields G, A, lb, ub, and, where it was asked for, the
judgement of an answer, whose nearest feasible point is itself the optimum of a program with P = I and q = −x.
``docs/certificates.md`` describes every field; ``examples/check_certificate.py`` checks them all.
"""

from typing import Any

import numpy as np
from flint import fmpq
from qpsolvers import Problem

from solvers.arrays import Vector
from solvers.certificate import Certificate, stored_point
from solvers.checks import finite
from solvers.exact.active_set import is_unique_by_rank, nearest_feasible_point, uniqueness
from solvers.exact.linear_algebra import WORK, Rational, RationalColumn, Work, column, nearest_double
from solvers.exact.problem import DoubleProblem, exact
from solvers.exact.program import ExactProgram, Kind, Point

FORMAT = "certificate of a quadratic program, version 1"
FIELDS = {Kind.ROW: "G", Kind.EQUALITY: "A", Kind.LOWER: "lb", Kind.UPPER: "ub"}
"""The field of the data that a constraint is in, which has its multiplier in the document."""


def document(
    problem: Problem,
    certificate: Certificate,
    *,
    constant: float = 0.0,
    answer: Vector | None = None,
    work: float = WORK,
) -> dict[str, Any]:
    """The numbers of a proof, for ``json.dumps``.

    Parameters
    ----------
    problem : qpsolvers.Problem
    certificate : Certificate
        Of this problem.
    constant : float
        Constant term of the cost, which the optimal value includes.
    answer : array, shape (d,), optional
        An answer to judge.
    work : float
        Limit of the work on a second optimum.

    Raises
    ------
    ValueError
        NaN, an infinity or a wrong shape in the answer.

    Examples
    --------
    >>> from solvers.certificate import certify
    >>> program = Problem(np.eye(2), np.array([-3.0, 1.0]), lb=np.zeros(2), ub=np.full(2, 2.0))
    >>> found = document(program, certify(program, np.zeros(2)), answer=np.array([1.5, 0.0]))
    >>> found["optimum"]["x"], found["optimum"]["ub"], found["unique"], found["answer"]["gap"]
    (['2', '0'], ['1', '0'], 'yes', '5/8')
    """
    data = DoubleProblem(problem)
    program, factor = exact(data, certificate.convexity_shift)
    point = stored_point(program, certificate)
    value = program.value(point.x) * factor + _rational(constant)
    unique, other = _uniqueness(program, point, work)
    tight = [c for k, c in enumerate(program.constraints) if point.slacks.get(k, 0) == 0]
    contents = {
        "format": FORMAT,
        "problem": {name: _doubles(getattr(data, name)) for name in ("P", "q", "G", "h", "A", "b", "lb", "ub")},
        "constant": float(constant).hex(),
        "shift": certificate.convexity_shift.hex(),
        "optimum": _optimum(data, program, point, factor) | {"value": str(value)},
        "active": {name: sorted(c.index for c in tight if c.kind is kind) for kind, name in FIELDS.items()},
        "rounded": {"x": list(map(repr, certificate.x)), "value": repr(nearest_double(value))},
        "unique": unique,
    }
    if other is not None:
        contents["second_optimum"] = _texts(other)
    if answer is not None:
        x = column(finite("the answer", answer, data.q.shape))
        projection, nearest = nearest_feasible_point(program, x)
        distance, violation = (max(map(abs, (x - y).entries())) for y in (point.x, nearest.x))
        contents["answer"] = {
            "x": _doubles(np.asarray(answer, dtype=np.float64)),
            "nearest": _optimum(data, projection, nearest, fmpq(1)),
            "gap": str((program.value(nearest.x) - program.value(point.x)) * factor),
            "violation": str(violation),
            "distance": str(distance),
        }
    return contents


def _rational(value: float) -> Rational:
    return fmpq(*float(value).as_integer_ratio())


def _doubles(values: Any) -> Any:
    return [_doubles(row) for row in values] if np.ndim(values) else float(values).hex()


def _texts(x: RationalColumn) -> list[str]:
    return [str(entry) for entry in x.entries()]


def _optimum(data: DoubleProblem, program: ExactProgram, point: Point, factor: Rational) -> dict[str, list[str]]:
    """x and the multipliers of every constraint, in the units of the data."""
    rows = {"G": data.G, "A": data.A}
    multipliers = {name: ["0"] * len(getattr(data, name)) for name in FIELDS.values()}
    for k, multiplier in point.multipliers.items():
        constraint = program.constraint(k)
        if multiplier == 0 or constraint.kind is Kind.PIN:
            continue
        name, scale = FIELDS[constraint.kind], factor
        if constraint.a is not None:  # a is the row times a power of two
            j = next(j for j, entry in enumerate(constraint.a) if entry != 0)
            scale *= fmpq(constraint.a[j]) / _rational(rows[name][constraint.index, j])
        multipliers[name][constraint.index] = str(multiplier * scale)
    return {"x": _texts(point.x), **multipliers}


def _uniqueness(program: ExactProgram, point: Point, work: float) -> tuple[str, RationalColumn | None]:
    """Whether x* is the only optimum, "yes" only where a rank shows it, and another optimum if there is one."""
    if is_unique_by_rank(program, point):
        return "yes", None
    _, direction = uniqueness(program, point, Work(work))
    if direction is None:
        return "undecided", None
    rates = program.along(direction)
    steps = [slack / rates[k] for k, slack in point.slacks.items() if slack > 0 and rates[k] > 0]
    return "no", point.x + direction * min(steps, default=fmpq(1))
