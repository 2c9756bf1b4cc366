"""The forms of the constraints say the same as the problem, and the triangles hold every entry."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from qpsolvers import Problem

from solvers.protocol import Vector
from solvers.rows import Cones, Intervals, Program, Triangle


def problem() -> Problem:
    """One variable of each kind: bounded below, above, on both sides, fixed, free; two of three rows of G are real."""
    d = 5
    rng = np.random.default_rng(0)
    M = rng.normal(size=(8, d))
    lb = np.array([0.0, -np.inf, -1.0, 0.5, -np.inf])
    ub = np.array([np.inf, 2.0, 1.0, 0.5, np.inf])
    return Problem(
        M.T @ M,
        rng.normal(size=d),
        rng.normal(size=(3, d)),
        np.array([1.0, np.inf, 2.0]),
        rng.normal(size=(1, d)),
        np.array([0.3]),
        lb,
        ub,
    )


def allowed(program: Program, x: Vector) -> bool:
    value = program.R @ x
    return bool(np.all((value >= program.l - 1e-12) & (value <= program.u + 1e-12)))


def test_no_form_has_a_dead_row() -> None:
    program = Program(problem())
    intervals, cones = Intervals(program), Cones(program)
    assert program.l.size == 5 + 1 + 2
    assert intervals.l.size == 4 + 1 + 2
    assert np.all(np.isfinite(intervals.l) | np.isfinite(intervals.u))
    assert (cones.equal, cones.unequal) == (2, 4 + 2)
    assert np.all(np.isfinite(cones.r))


def test_forms_allow_the_same_points() -> None:
    given = problem()
    program = Program(given)
    intervals, cones = Intervals(program), Cones(program)
    line = np.linalg.lstsq(np.vstack([given.A, np.eye(5)[3]]), np.array([0.3, 0.5]), rcond=None)[0]
    across = np.linalg.svd(np.vstack([given.A, np.eye(5)[3]]))[2][2:]
    rng = np.random.default_rng(1)
    verdicts = []
    for _ in range(300):
        x = line + across.T @ rng.normal(scale=0.7, size=3)
        value, slack = intervals.R @ x, cones.r - cones.R @ x
        verdict = allowed(program, x)
        verdicts.append(verdict)
        assert verdict == bool(np.all((value >= intervals.l - 1e-12) & (value <= intervals.u + 1e-12)))
        assert verdict == bool(np.all(np.abs(slack[: cones.equal]) < 1e-12) and np.all(slack[cones.equal :] > -1e-12))
    assert any(verdicts)
    assert not all(verdicts)


@pytest.mark.parametrize("form", [Intervals, Cones])
def test_spread_multipliers_push_as_the_rows_of_the_form_do(form: type[Intervals] | type[Cones]) -> None:
    program = Program(problem())
    rows = form(program)
    w = np.random.default_rng(2).uniform(0.5, 1.0, size=rows.R.shape[0])
    np.testing.assert_allclose(program.R.T @ rows.distribute(w), rows.R.T @ w)


def test_solution_sorts_the_multipliers_into_their_kinds() -> None:
    program = Program(problem())
    w = np.arange(1.0, 9.0)
    solution = program.solution(np.zeros(5), w, True, status="solved", reported_us=None, iterations=3)
    np.testing.assert_array_equal(solution.z_box, [1, 2, 3, 4, 5])
    np.testing.assert_array_equal(solution.y, [6])
    np.testing.assert_array_equal(solution.z, [7, 0, 8])
    assert solution.extras == {"status": "solved", "reported_us": None, "iterations": 3}


def test_program_shares_no_memory_with_the_problem() -> None:
    given = problem()
    program = Program(given)
    for own in (program.P, program.q, program.R, program.l, program.u):
        for array in (given.P, given.q, given.G, given.h, given.A, given.b, given.lb, given.ub):
            assert not np.shares_memory(own, array)


@pytest.mark.parametrize("d", [1, 2, 5])
def test_triangle_stores_every_entry_in_the_order_of_compressed_columns(d: int) -> None:
    full = np.arange(1.0, d * d + 1).reshape(d, d)
    P = full + full.T
    for upper, cut in ((True, np.triu), (False, np.tril)):
        triangle = Triangle(d, upper)
        reference = sp.csc_matrix(cut(P))
        np.testing.assert_array_equal(triangle.indptr, reference.indptr)
        np.testing.assert_array_equal(triangle.indices, reference.indices)
        np.testing.assert_array_equal(triangle.values(P), reference.data)
        assert triangle.matrix(np.zeros((d, d))).data.size == d * (d + 1) // 2


def test_matrices_of_a_triangle_share_no_memory() -> None:
    triangle = Triangle(3)
    first, second = triangle.matrix(np.eye(3)), triangle.matrix(np.eye(3))
    for one, other in ((first.data, second.data), (first.indices, second.indices), (first.indptr, second.indptr)):
        assert not np.shares_memory(one, other)
