"""Solvers in files of one's own, as ``--solver FILE.py`` takes them, against the exact one."""

from pathlib import Path

import numpy as np
import pytest
from programs import library
from qpsolvers import Problem

import solvers

FOLDER = Path(__file__).parents[2] / "examples" / "adapters"
ERROR = {"scipy_slsqp": 1e-6, "casadi_qrqp": 1e-12}
"""Largest error of an answer near 1 and of its duals at the tightest rung."""


@pytest.mark.parametrize("name", ERROR)
def test_a_solver_in_a_file_has_the_answers_and_duals_of_the_exact_one(name: str) -> None:
    library(name.partition("_")[0])
    cls = solvers.from_file(FOLDER / f"{name}.py").load()
    own, exact, rng = cls(**cls.ladder(1.0)[-1]), solvers.get("box_active_set"), np.random.default_rng(5)
    A, b = rng.normal(size=(2, 24, 12)), rng.normal(size=(2, 24))
    P, q = A.transpose(0, 2, 1) @ A, -np.einsum("kij,ki->kj", A, b)
    problem = Problem(P[0], q[0], lb=np.zeros(12), ub=np.full(12, np.inf))
    for solver in (own, exact):
        solver.setup(problem)
    for data in zip(P, q, strict=True):
        for solver in (own, exact):
            solver.update(*data)
            solver.solve()
        answers = own.solution(), exact.solution()
        assert answers[0].found
        for part in ("x", "z_box"):
            found, expected = (getattr(answer, part) for answer in answers)
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=ERROR[name] * np.abs(expected).max())
