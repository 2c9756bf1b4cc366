"""The optimum of a small program by brute force, every active set in fractions, and programs to try it on."""

from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from itertools import chain, combinations

import numpy as np
from flint import fmpq, fmpq_mat
from hypothesis import strategies as st
from qpsolvers import Problem

INF = np.inf
Row = tuple[list[Fraction], Fraction]


def fractions(values: np.ndarray) -> list:
    return [fractions(v) for v in values] if np.ndim(values) else Fraction(float(values))


def rational(M: list[list[Fraction]]) -> fmpq_mat:
    return fmpq_mat([[fmpq(entry.numerator, entry.denominator) for entry in row] for row in M])


def constraint_rows(problem: Problem) -> tuple[list[Row], list[Row]]:
    """Inequalities aᵀx ≤ b and equalities of a problem."""
    d = len(problem.q)
    unit = [[Fraction(int(i == j)) for j in range(d)] for i in range(d)]
    inequalities = [] if problem.G is None else list(zip(fractions(problem.G), fractions(problem.h), strict=True))
    for bound, sign in ((problem.lb, -1), (problem.ub, 1)):
        if bound is not None:
            inequalities += [
                ([sign * e for e in unit[i]], sign * Fraction(float(v))) for i, v in enumerate(bound) if np.isfinite(v)
            ]
    equalities = [] if problem.A is None else list(zip(fractions(problem.A), fractions(problem.b), strict=True))
    return inequalities, [(a, b) for a, b in equalities if any(a) or b]  # 0 = 0 would make every system singular


def dot(a: list[Fraction], b: list[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def cost(problem: Problem, x: list[Fraction]) -> Fraction:
    P, q = fractions(problem.P), fractions(problem.q)
    return dot(x, [dot(row, x) for row in P]) / 2 + dot(q, x)


def feasible_stationary_points(problem: Problem) -> Iterator[list[Fraction]]:
    """The feasible stationary point of every active set whose optimality system is regular."""
    P, q = fractions(problem.P), fractions(problem.q)
    inequalities, equalities = constraint_rows(problem)
    d = len(q)
    for active in chain.from_iterable(combinations(inequalities, k) for k in range(d - len(equalities) + 1)):
        held = [*equalities, *active]
        K = [row + [a[i] for a, _ in held] for i, row in enumerate(P)]
        K += [a + [Fraction(0)] * len(held) for a, _ in held]
        right = rational([[-v] for v in q] + [[b] for _, b in held])
        with suppress(ZeroDivisionError):  # a singular system
            answer = [Fraction(int(v.p), int(v.q)) for v in rational(K).solve(right).entries()[:d]]
            if all(dot(a, answer) <= b for a, b in inequalities):
                yield answer


def lowest_cost(problem: Problem) -> Fraction | None:
    return min((cost(problem, x) for x in feasible_stationary_points(problem)), default=None)


# --- problems --------------------------------------------------------------------------------------------

small = st.integers(-4, 4)


@st.composite
def boxes(draw: st.DrawFn) -> Problem:
    """A convex problem with bounds only, d ≤ 4; P often singular, bounds often equal, optima often tied."""
    d = draw(st.integers(1, 4))
    factor = np.array(draw(st.lists(st.lists(small, min_size=d, max_size=d), min_size=1, max_size=d)), dtype=float)
    q = np.array(draw(st.lists(small, min_size=d, max_size=d)), dtype=float)
    lb = np.array(draw(st.lists(small, min_size=d, max_size=d)), dtype=float) / 4
    width = np.array(draw(st.lists(st.integers(0, 4), min_size=d, max_size=d)), dtype=float)
    return Problem(factor.T @ factor, q, lb=lb, ub=lb + width)


@st.composite
def polyhedra(draw: st.DrawFn) -> Problem:
    """A convex problem with general rows, d ≤ 3; may be infeasible or unbounded, rows may depend on each other."""
    d = draw(st.integers(1, 3))

    def matrix(low: int, high: int) -> np.ndarray:
        rows = draw(st.lists(st.lists(small, min_size=d, max_size=d), min_size=low, max_size=high))
        return np.array(rows, dtype=float).reshape(-1, d)

    def vector(n: int) -> np.ndarray:
        return np.array(draw(st.lists(small, min_size=n, max_size=n)), dtype=float)

    factor, G, A = matrix(1, d), matrix(0, 4), matrix(0, min(d - 1, 1)) if d > 1 else np.zeros((0, d))
    lb = np.where(vector(d) > 0, -INF, -2.0)
    return Problem(
        factor.T @ factor,
        vector(d),
        G=G if len(G) else None,
        h=vector(len(G)) if len(G) else None,
        A=A if len(A) else None,
        b=vector(len(A)) if len(A) else None,
        lb=lb,
    )


def gram_problem(d: int, seed: int, rows_per_variable: int = 4) -> Problem:
    """A badly conditioned least-squares problem over x ≥ 0 with about half of the bounds active."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(rows_per_variable * d, d)) + 20 * rng.normal(size=(rows_per_variable * d, 1))
    target = columns @ np.maximum(rng.normal(size=d), 0) + 0.1 * rng.normal(size=len(columns))
    return Problem(columns.T @ columns, -columns.T @ target, lb=np.zeros(d), ub=np.full(d, INF))


corner = Problem(np.array([[2.0, 0.0], [0.0, 4.0]]), np.array([-2.0, 4.0]), lb=np.zeros(2), ub=np.full(2, 3.0))
"""Optimum (1, 0) with V = −1, found by hand: variable 0 free, variable 1 at its lower bound with multiplier 4."""
