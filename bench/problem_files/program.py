"""The result of a reader, its checks, and the conversion of two-sided rows to those of qpsolvers.

    l ≤ C x ≤ u   becomes   A x = b  if l = u,   C x ≤ u  if u is finite,   −C x ≤ −l  if l is finite

Magnitudes of at least 1e20 mean infinity in MPS files and in the usual conversions of the Maros–Mészáros set.
"""

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from qpsolvers import Problem
from scipy.sparse import csc_matrix, vstack

from piezo_model.checks import check as check
from solvers.arrays import Vector

INFINITY = 1e20
"""Smallest magnitude that means infinity."""
SYMMETRY = 1e-12
"""Largest difference between P and Pᵀ, relative to the largest element, that is a rounding error."""

QP_FIELDS = ("P", "q", "G", "h", "A", "b", "lb", "ub")
OF_CONSTRAINTS = (*QP_FIELDS[2:], "l", "u")
MOST_BYTES = 2**28
"""Largest size of a program's file, decompressed; the longest text of the Maros–Mészáros set has a tenth of that."""


def fields_of(qp: Problem) -> dict[str, Any]:
    """The fields of a program by name."""
    return {name: getattr(qp, name) for name in QP_FIELDS}


class ProblemFileError(ValueError):
    """An invalid program file; the message is one sentence that begins with the path."""


@dataclass(frozen=True)
class ReadProgram:
    """A program to be minimised, the constant term of its cost, and −1 as ``sense`` if its file maximises the negative
    of both."""

    qp: Problem
    constant: float = 0.0
    sense: float = 1.0


@contextmanager
def about(path: Any, what: str = "", damaged: type[Exception] = ValueError) -> Iterator[None]:
    """Turn an exception into a ProblemFileError that names the file, unless it does already, and says what failed;
    libraries raise any exception for a damaged file."""
    try:
        yield
    except damaged as error:
        reason = str(getattr(error, "strerror", None) or error)
        raise ProblemFileError(reason if reason.startswith(f"{path}: ") else f"{path}: {what}{reason}") from None


def refuse_unread(
    shapes: Mapping[str, Sequence[int]], fields: Container[str], d: int, rows: Iterable[int], constraints: str
) -> None:
    """ValueError for an array of a file that is none of the ``fields`` and may be a constraint: it has the name of a
    field of another format, or as many rows or columns as there are variables or rows of a kind."""
    sizes = {d, *rows} - {0, 1} if d > 1 else {1}  # only the bound of a single variable is a single number
    for name, shape in shapes.items():
        check(
            name in fields or (name not in OF_CONSTRAINTS and sizes.isdisjoint(shape)),
            f"holds {name}, which is not read; constraints are {constraints}",
        )


def doubles(name: str, values: Any) -> Any:
    """Numbers of a file as doubles, dense or sparse; ValueError for complex numbers, text, or numbers that doubles do
    not represent."""
    numbers = values if isinstance(values, np.ndarray) else values.data
    check(
        numbers.dtype.kind in "biuf", f"{name} holds {'complex numbers' if numbers.dtype.kind == 'c' else 'no numbers'}"
    )
    with np.errstate(invalid="ignore"):
        rounded = numbers.astype(np.float64)
        exact = np.array_equal(rounded.astype(numbers.dtype), numbers, equal_nan=numbers.dtype.kind == "f")
    check(exact, f"{name} holds numbers that double precision cannot represent")
    if isinstance(values, np.ndarray):
        return rounded
    return csc_matrix((rounded, values.indices, values.indptr), shape=values.shape)


def vector(name: str, values: Any) -> Vector:
    """A dense or sparse vector of any orientation, shape (n,); ValueError for a matrix."""
    dense = values if isinstance(values, np.ndarray) else values.toarray()
    check(dense.size == max(dense.shape, default=1), f"{name} must be a vector, not of shape {dense.shape}")
    return doubles(name, dense).ravel()


def constant_term(name: str, values: Any) -> float:
    """The constant term of a cost; ValueError unless it is one finite number."""
    constant = doubles(name, np.asarray(values)).ravel()
    check(constant.size == 1 and np.isfinite(constant[0]), f"the constant {name} must be one finite number")
    return float(constant[0])


def compressed_columns(name: str, data: Any, indices: Any, indptr: Any, shape: Any) -> csc_matrix:
    """A matrix in compressed columns; ValueError for invalid index arrays, before any compiled code uses them."""
    data, indices, indptr, shape = (np.asarray(array) for array in (data, indices, indptr, shape))
    check(
        shape.shape == (2,)
        and all(array.dtype.kind in "iu" for array in (indices, indptr, shape))
        and (shape >= 0).all(),
        f"{name} has a shape or indices that are not whole numbers",
    )
    rows, count = (int(size) for size in shape)
    check(
        all(array.ndim == 1 for array in (data, indices, indptr))
        and indptr.size == count + 1
        and indices.size == data.size,
        f"{name} is of shape ({rows}, {count}) and its index arrays are not",
    )
    check(
        indptr[0] == 0 and indptr[-1] == data.size and (indptr[1:] >= indptr[:-1]).all(),
        f"{name} has columns that do not begin at the end of the previous one",
    )
    check(
        not indices.size or (indices.min() >= 0 and indices.max() < rows),
        f"{name} has an element outside its {rows} rows",
    )
    M = csc_matrix((data, indices.astype(np.int64), indptr.astype(np.int64)), shape=(rows, count))
    M.sort_indices()
    check(M.has_canonical_format, f"{name} has an element twice")
    return M


def with_infinities(values: Any) -> Any:
    """Bounds with magnitudes of at least INFINITY replaced by infinity."""
    return np.where(np.abs(values) >= INFINITY, np.copysign(np.inf, values), values)


def check_sides(**sides: Vector) -> None:
    """ValueError for NaN, for a lower side (l, lb) of +∞, and for an upper side of −∞."""
    for name, values in sides.items():
        bounds, infeasible = with_infinities(values), np.inf if name in ("l", "lb") else -np.inf
        for i in np.flatnonzero(np.isnan(bounds) | (bounds == infeasible)):
            raise ValueError(f"{name}[{i}] is {bounds[i]}, which no value satisfies")


def two_sided(P: Any, q: Vector, C: Any, l: Vector, u: Vector, lb: Vector, ub: Vector) -> Problem:  # noqa: E741
    """The program with rows l ≤ C x ≤ u and bounds; every matrix is sparse.

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
    return Problem(
        csc_matrix(P),
        q,
        *((G, h + 0.0) if h.size else (None, None)),
        *((A, b) if b.size else (None, None)),
        lb if np.isfinite(lb).any() else None,
        ub if np.isfinite(ub).any() else None,
    )


def checked(qp: Problem) -> Problem:
    """The program with an exactly symmetric P; ValueError for wrong shapes, non-finite numbers, or an asymmetric P."""
    d, fields = qp.q.size, {name: value for name, value in fields_of(qp).items() if value is not None}
    check(d, "has no variables")
    shapes = {"P": (d, d), **dict.fromkeys(("q", "lb", "ub"), (d,))}
    for rows, right in (("G", "h"), ("A", "b")):
        there, absent = (rows, right) if rows in fields else (right, rows)
        check(there not in fields or absent in fields, f"has {there} without {absent}")
        if right in fields:
            shapes |= {right: (fields[right].size,), rows: (fields[right].size, d)}
    for name, value in fields.items():
        check(
            value.shape == shapes[name],
            f"{name}: expected shape {shapes[name]} for the {d} variables of q, got {value.shape}",
        )
        check(
            name in ("h", "lb", "ub") or np.isfinite(value if isinstance(value, np.ndarray) else value.data).all(),
            f"{name} has an element that is not a finite number",
        )
    check_sides(**{name: fields[name] for name in ("h", "lb", "ub") if name in fields})
    difference = abs(qp.P - qp.P.T)
    check(
        not difference.size or difference.max() <= SYMMETRY * abs(qp.P).max(),
        "P is not symmetric; one triangle alone is not accepted",
    )
    P = 0.5 * qp.P + 0.5 * qp.P.T
    return Problem(P if isinstance(P, np.ndarray) else csc_matrix(P), qp.q, qp.G, qp.h, qp.A, qp.b, qp.lb, qp.ub)
