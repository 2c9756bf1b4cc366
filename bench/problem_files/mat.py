"""Programs of the Maros–Mészáros set in the usual conversion to MATLAB files.

    minimise ½ xᵀP x + qᵀx + r   subject to   l ≤ A x ≤ u

with variables of these names. The bounds of x are rows of A that are unit vectors (A ends with the identity); they
become bounds again here.

Source: I. Maros, C. Mészáros, "A repository of convex quadratic programming problems", Optim. Methods Softw. 11 (1999)
671–681.
"""

from pathlib import Path

import numpy as np
from scipy.sparse import csc_matrix, issparse

from bench.problem_files.program import (
    MOST_BYTES,
    ReadProgram,
    about,
    check,
    check_sides,
    checked,
    compressed_columns,
    constant_term,
    doubles,
    refuse_unread,
    two_sided,
    vector,
)


def read_mat(path: Path) -> ReadProgram:
    """Read P, q, r, A, l and u; r is optional, and so are A, l and u together. ValueError for an invalid file."""
    # the readers of all formats of recordings are imported with it, which no process of a solver needs
    from piezo_model.recordings.formats.mat_5 import read_mat_5

    with about(path, "cannot be read as a MATLAB file of versions 5 to 7: ", Exception):
        variables = read_mat_5(path, MOST_BYTES, simplify=False)
    for name in ("P", "q", *(("l", "u") if "A" in variables else ())):
        check(name in variables, f"holds no variable {name!r}")
    fields = ("P", "q", "r", *(("A", "l", "u") if "A" in variables else ()))
    shapes = {
        name: value.shape
        for name, value in variables.items()
        if issparse(value) or getattr(value, "dtype", np.dtype(object)).kind in "biufc"
    }
    variables = {
        name: doubles(
            name,
            compressed_columns(name, value.data, value.indices, value.indptr, value.shape)
            if issparse(value)
            else value,
        )
        for name, value in variables.items()
        if name in fields
    }
    q, P = vector("q", variables["q"]), csc_matrix(variables["P"])
    d = q.size
    C = csc_matrix(variables["A"]) if "A" in variables else csc_matrix((0, d))
    l, u = (vector(name, variables[name]) if "A" in variables else np.zeros(0) for name in ("l", "u"))  # noqa: E741
    check_sides(l=l, u=u)
    constant = constant_term("r", variables.get("r", 0.0))
    for name, shape, right in (("P", P.shape, (d, d)), ("A", C.shape, (l.size, d)), ("u", u.shape, l.shape)):
        check(shape == right, f"{name}: expected shape {right} for the {d} variables of q, got {shape}")
    lb, ub = np.full(d, -np.inf), np.full(d, np.inf)
    rows = C.tocsr()
    rows.eliminate_zeros()
    single = np.flatnonzero(np.diff(rows.indptr) == 1)
    units = single[rows.data[rows.indptr[single]] == 1.0]
    columns = rows.indices[rows.indptr[units]]
    np.maximum.at(lb, columns, l[units])
    np.minimum.at(ub, columns, u[units])
    others = np.setdiff1d(np.arange(l.size), units)
    qp = checked(two_sided(P, q, rows[others], l[others], u[others], lb, ub))
    refuse_unread(shapes, (*fields, "m", "n"), d, {l.size, u.size}, "l <= A x <= u")
    return ReadProgram(qp, constant)
