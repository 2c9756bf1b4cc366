"""The iterate of a solver that its iteration limit ended."""

import numpy as np
import pytest
from programs import that_load
from qpsolvers import Problem

import solvers
from solvers import Lane
from solvers.certificate import certify, exact_cost_gap

LIMITED = [
    entry
    for entry in solvers.available()
    if entry.lane is Lane.DIRECT and entry.load().iteration_setting not in (None, "steps")
]


@pytest.fixture(scope="module")
def hard() -> Problem:
    """A badly conditioned problem with some bounds active, which no iterative method solves in three steps."""
    generator = np.random.default_rng(4)
    A = generator.normal(size=(40, 12)) @ np.diag(10.0 ** -np.linspace(0.0, 2.5, 12))
    P = A.T @ A
    D = 1.0 / np.sqrt(np.diag(P))
    P = P * D * D[:, None]
    return Problem(0.5 * (P + P.T), generator.normal(size=12), lb=np.zeros(12), ub=np.full(12, np.inf))


def test_the_libraries_that_have_a_limit_name_it() -> None:
    assert {entry.name for entry in LIMITED} >= {
        "osqp",
        "scs",
        *that_load("proxsuite"),
        "piqp",
        "clarabel",
        "qpalm",
        "qoco",
    }


@pytest.mark.parametrize("entry", LIMITED, ids=lambda entry: entry.name)
def test_the_iterate_at_the_limit_can_be_had_is_no_answer_and_comes_closer_as_the_limit_grows(
    entry: solvers.registry.Entry, hard: Problem
) -> None:
    cls, proof, gaps = entry.load(), certify(hard, np.zeros(12)), []
    for limit in (2, 3, 20_000):
        solver = cls(**{**cls.ladder(1.0)[-1], str(cls.iteration_setting): limit})
        solver.setup(hard)
        x = solver.solve().copy()
        if np.isnan(x).all():
            assert not solver.solution().found
            iterate = solver.iterate()
            assert iterate is not None
            x = iterate
        else:
            assert limit > 3
        gap = exact_cost_gap(hard, proof, x, c=-2.0 * proof.value_rounded)
        gaps.append(gap.relative + gap.violation)
    assert gaps[-1] < 1e-3 * gaps[0]


@pytest.mark.parametrize("entry", LIMITED, ids=lambda entry: entry.name)
def test_a_solve_that_finished_has_no_iterate_beside_its_answer(entry: solvers.registry.Entry, hard: Problem) -> None:
    cls = entry.load()
    solver = cls(**cls.ladder(1.0)[0])
    solver.setup(hard)
    assert np.isfinite(solver.solve()).all()
    assert solver.iterate() is None
