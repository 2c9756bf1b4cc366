"""Programs in the style of the Maros–Mészáros set, drawn at random and written exactly, and whether two are the same.

They have equalities, ranges, one-sided rows, free and fixed variables and a singular sparse P.
"""

from pathlib import Path

import numpy as np
from qpsolvers import Problem
from scipy.sparse import issparse, spmatrix

from bench.problem_files.program import QP_FIELDS, fields_of
from bench.problems import RaceProblem

DRAWN = Path(__file__).with_name("programs")
"""The folder of ``drawn.mps``, the same program as the usual conversion ``drawn.mat``, and ``other.mps``."""


def dense(matrix: np.ndarray | spmatrix) -> np.ndarray:
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()


def same(a: Problem, b: Problem) -> bool:
    return all(
        (x is None and y is None) or np.array_equal(dense(x), dense(y))
        for x, y in ((getattr(a, name), getattr(b, name)) for name in QP_FIELDS)
    )


def same_problem(a: RaceProblem, b: RaceProblem) -> bool:
    """Whether two problems, their proofs and unseen data are exactly equal."""

    def parts(problem: RaceProblem) -> list[object]:
        found: list[object] = [problem.name, problem.d, problem.sense, [*problem.forms]]
        for form in problem.forms.values():
            found += [*fields_of(form.qp).values(), form.to_weights, *form.starts, *form.starts.values()]
            found += [form.certificate, form.c, form.cost_unit]
            found += [getattr(window, name) for window in form.windows for name in "Pqc"]
        v = problem.validation
        return found + ([] if v is None else [v.state.play, v.state.creep, v.x, v.y, v.noise_um])

    def plain(value: object) -> object:
        found = dense(value) if issparse(value) else value
        return (issparse(value), found.tobytes()) if isinstance(found, np.ndarray) else found

    return [*map(plain, parts(a))] == [*map(plain, parts(b))]
