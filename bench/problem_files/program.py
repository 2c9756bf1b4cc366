"""What every reader returns, and the way from rows with two sides to the rows of qpsolvers.

    l ≤ C x ≤ u   becomes   A x = b  where l = u,   C x ≤ u  where u is finite,   −C x ≤ −l  where l is finite

Magnitudes from 1e20 on stand for infinity in MPS files and in the usual conversions of the Maros–Mészáros set.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from qpsolvers import Problem
from scipy.sparse import csc_matrix, vstack

Vector = NDArray[np.float64]

INFINITY = 1e20
SYMMETRY = 1e-12
"""Difference between P and Pᵀ, as a share of the largest element, that is taken for rounding."""


class ProblemFileError(ValueError):
    """A file that holds no program that can be read; the message is one sentence that begins with the path."""


@dataclass(frozen=True)
class ReadProgram:
    """A program and the constant term of its cost."""

    qp: Problem
    constant: float = 0.0


def with_infinities(values: Vector) -> Vector:
    """Bounds with what stands for infinity replaced by it."""
    return np.where(np.abs(values) >= INFINITY, np.copysign(np.inf, values), values)


def two_sided(P: Any, q: Vector, C: Any, l: Vector, u: Vector, lb: Vector, ub: Vector) -> Problem:  # noqa: E741
    """The program with rows l ≤ C x ≤ u and bounds, every matrix sparse.

    Examples
    --------
    >>> nothing = np.full(2, np.inf)
    >>> qp = two_sided(csc_matrix(np.eye(2)), np.zeros(2), csc_matrix([[1.0, 1.0], [1.0, -1.0]]), np.array([1.0, 0.0]),
    ...                np.array([1.0, 2.0]), -nothing, nothing)
    >>> qp.A.toarray().tolist(), qp.b.tolist(), qp.G.toarray().tolist(), qp.h.tolist(), qp.lb
    ([[1.0, 1.0]], [1.0], [[1.0, -1.0], [-1.0, 1.0]], [2.0, 0.0], None)
    """
    l, u, lb, ub = (with_infinities(side) for side in (l, u, lb, ub))  # noqa: E741
    C = csc_matrix(C).tocsr()
    equal, upper, lower = l == u, (l != u) & np.isfinite(u), (l != u) & np.isfinite(l)
    G, h = vstack([C[upper], -C[lower]], format="csc"), np.concatenate([u[upper], -l[lower]])
    A, b = csc_matrix(C[equal]), u[equal]
    return Problem(csc_matrix(P), q, *((G, h + 0.0) if h.size else (None, None)), *((A, b) if b.size else (None, None)),
                   lb if np.isfinite(lb).any() else None, ub if np.isfinite(ub).any() else None)


def checked(path: Any, qp: Problem) -> Problem:
    """The program, its P symmetric to the last bit; ProblemFileError where shapes disagree or P is not symmetric."""
    d = qp.q.size
    if not d:
        raise ProblemFileError(f"{path}: has no variables")
    shapes = [("P", qp.P, (d, d)), *((name, getattr(qp, name), (d,)) for name in ("lb", "ub"))]
    for rows, right in (("G", "h"), ("A", "b")):
        M, v = getattr(qp, rows), getattr(qp, right)
        if (M is None) != (v is None):
            raise ProblemFileError(f"{path}: has {rows if v is None else right} without {right if v is None else rows}")
        if v is not None:
            shapes += [(right, v, (v.size,)), (rows, M, (v.size, d))]
    for name, value, shape in shapes:
        if value is not None and value.shape != shape:
            raise ProblemFileError(f"{path}: {name} is of shape {value.shape} and not {shape}, for the {d} variables of q")
    for name in ("P", "q", "G", "A", "b"):
        value = getattr(qp, name)
        if value is not None and not np.isfinite(value if isinstance(value, np.ndarray) else value.data).all():
            raise ProblemFileError(f"{path}: {name} has an element that is not a finite number")
    difference = abs(qp.P - qp.P.T)
    if difference.size and difference.max() > SYMMETRY * abs(qp.P).max():
        raise ProblemFileError(f"{path}: P is not symmetric; one that holds a triangle only is not guessed at")
    P = 0.5 * (qp.P + qp.P.T)
    return Problem(P if isinstance(P, np.ndarray) else csc_matrix(P), qp.q, qp.G, qp.h, qp.A, qp.b, qp.lb, qp.ub)
