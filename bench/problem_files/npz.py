"""Programs as arrays in an NPZ file: minimise ½ xᵀP x + qᵀx subject to G x ≤ h, A x = b, lb ≤ x ≤ ub.

A matrix is stored dense under its name, or in compressed columns as ``P/data``, ``P/indices``, ``P/indptr`` and
``P/shape``. A file saved by qpsolvers has a pickled None for an absent field; nothing is unpickled here.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from qpsolvers import Problem
from scipy.sparse import csc_matrix

from bench.problem_files.program import (
    MOST_BYTES,
    QP_FIELDS,
    ProblemFileError,
    ReadProgram,
    about,
    check,
    checked,
    compressed_columns,
    constant_term,
    doubles,
    refuse_unread,
    vector,
    with_infinities,
)
from solvers.arrays import Vector

CSC_FIELDS = ("data", "indices", "indptr", "shape")
BESIDE = (
    "c",
    "r",
    "raw",
    "scaled",
    "validation",
    "meta",
    "first",
    "x",
    "optimum",
    "unit",
    "solver",
    "lane",
    "settings",
)
"""Further names, or beginnings of names, in files of programs, of problems with their proofs, and of misses."""
PARTNER = {"G": "h", "A": "b"}
"""The side of rows, without which they may be absent."""


def packed(name: str, value: Any) -> dict[str, Any]:
    """The arrays that store one value: dense, sparse, or None (no arrays).

    Examples
    --------
    >>> sorted(packed("P", csc_matrix(np.eye(2))))
    ['P/data', 'P/indices', 'P/indptr', 'P/shape']
    """
    if value is None:
        return {}
    if isinstance(value, np.ndarray):
        return {name: value}
    M = csc_matrix(value)
    return {f"{name}/{field}": np.asarray(getattr(M, field)) for field in CSC_FIELDS}


def unpacked(arrays: Mapping[str, Any], name: str) -> Any:
    """The inverse of :func:`packed`; ValueError if the arrays are not a matrix of doubles."""
    if name in arrays:
        return doubles(name, arrays[name])
    if f"{name}/data" not in arrays:
        return None
    return doubles(name, compressed_columns(name, *(arrays[f"{name}/{field}"] for field in CSC_FIELDS)))


def packed_program(qp: Problem, prefix: str = "") -> dict[str, Any]:
    """The arrays that store a program."""
    return {key: array for field in QP_FIELDS for key, array in packed(prefix + field, getattr(qp, field)).items()}


def unpacked_program(arrays: Mapping[str, Any], prefix: str = "") -> Problem:
    """The inverse of :func:`packed_program`."""
    return Problem(*(unpacked(arrays, prefix + field) for field in QP_FIELDS))


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open an NPZ file; errors of reading its arrays become a ProblemFileError."""
    reading = about(path, "cannot be read as NPZ: ", Exception)
    with reading, path.open("rb") as file, np.lib.npyio.NpzFile(file) as arrays:
        list(_headers(arrays))  # which checks their sizes, before memory is taken for any of them
        try:
            yield arrays
        except KeyError as error:
            raise ProblemFileError(f"{path}: holds no array {error.args[0]!r}") from None


def read_npz(path: Path) -> ReadProgram:
    """Read a program under the names above, with an optional constant term ``c`` or ``r``; ValueError for an invalid
    file. Of a problem that a race has stored, it is the program in original units, without the constant term."""
    with opened(path) as arrays:
        pickled = {name: dtype.hasobject for name, dtype in _headers(arrays)}
        values = {name: arrays[name] for name, is_object in pickled.items() if not is_object}
        prefix = "raw/" if "raw/P" in values or "raw/P/data" in values else ""
        fields = {name: unpacked(values, prefix + name) for name in QP_FIELDS}
    for name in filter(pickled.get, pickled):
        is_needed = name in ("P", "q", "c", "r") or PARTNER.get(name) in values  # so it is not a None
        check(
            not is_needed and name.partition("/")[0] in (*QP_FIELDS, *BESIDE),
            f"{name} is stored as a Python object, which is not read; store sparse matrices as "
            f"{', '.join(f'{name}/{field}' for field in CSC_FIELDS)}",
        )
    constant = next((constant_term(name, values[name]) for name in ("c", "r") if name in values), 0.0)
    for name in ("P", "q"):
        check(fields[name] is not None, f"holds no {name}; a program has P and q at least")
    fields |= {name: vector(name, fields[name]) for name in ("q", "h", "b", "lb", "ub") if fields[name] is not None}
    fields |= {name: with_infinities(fields[name]) for name in ("h", "lb", "ub") if fields[name] is not None}
    qp = checked(Problem(**fields))
    rows = [side.size for side in (qp.h, qp.b) if side is not None]
    unread = {key: value for key, value in values.items() if key.partition("/")[0] not in (*QP_FIELDS, *BESIDE)}
    sparse = {
        key.removesuffix("/shape"): np.ravel(value).tolist() for key, value in unread.items() if key.endswith("/shape")
    }
    dense = {
        key: value.shape
        for key, value in unread.items()
        if value.dtype.kind in "biufc" and key.rpartition("/")[0] not in sparse
    }
    refuse_unread(sparse | dense, (), qp.q.size, rows, "G x <= h, A x = b, lb <= x <= ub")
    return ReadProgram(qp, constant)


def read_answer(path: Path, size: int) -> Vector:
    """The answer (size,) in an NPY file; ProblemFileError for anything else."""
    with about(path):
        with about(path, "cannot be read as NPY: ", Exception):
            x = np.load(path, allow_pickle=False)
        check(isinstance(x, np.ndarray) and x.dtype.kind in "iuf", "holds no array of real numbers")
        check(x.shape == (size,), f"expected shape ({size},), one number for each variable, got {x.shape}")
        check(np.isfinite(x).all(), "has an element that is not a finite number")
        return np.asarray(x, dtype=np.float64)


def _headers(arrays: Any) -> Iterator[tuple[str, np.dtype[Any]]]:
    """Name and type of each array, without reading it; ValueError for a size that is not that of the file."""
    members = arrays.zip.infolist()
    size = sum(member.file_size for member in members)
    check(size <= MOST_BYTES, f"holds {size} bytes of arrays, and at most {MOST_BYTES} are read")
    for member in members:
        if member.filename.endswith(".npy"):
            with arrays.zip.open(member) as file:
                header = "1_0" if np.lib.format.read_magic(file) == (1, 0) else "2_0"
                shape, _, dtype = getattr(np.lib.format, f"read_array_header_{header}")(file)
            name = member.filename.removesuffix(".npy")
            least = 0 if dtype.hasobject else math.prod(shape) * dtype.itemsize
            check(least <= member.file_size, f"{name} is shorter than its header says")
            yield name, dtype
