"""Quadratic programs in files: one module per format; :func:`read` selects it by the suffix."""

from collections.abc import Callable, Mapping
from pathlib import Path

from bench.problem_files.mat import read_mat
from bench.problem_files.npz import read_npz
from bench.problem_files.program import ProblemFileError, ReadProgram, about, require
from bench.problem_files.qps import read_qps

__all__ = ["READERS", "ProblemFileError", "ReadProgram", "read"]

READERS: Mapping[str, Callable[[Path], ReadProgram]] = {
    ".npz": read_npz,
    ".mat": read_mat,
    ".qps": read_qps,
    ".mps": read_qps,
}
"""Reader by lower-case suffix; it raises ValueError for an invalid file, without the file's name."""


def read(path: Path) -> ReadProgram:
    """The program in a file; ProblemFileError for an invalid file."""
    suffix = path.suffix.lower()
    with about(path):
        require(suffix in READERS, f"unknown suffix {path.suffix!r}; a program is in {', '.join(READERS)}")
        return READERS[suffix](path)
