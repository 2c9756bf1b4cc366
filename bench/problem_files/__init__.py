"""Quadratic programs in files: one module a format, and :func:`read` tells them apart by the suffix."""

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
"""Reader by suffix, in small letters; what it finds wrong is a ValueError, whose sentence need not name the file."""


def read(path: Path) -> ReadProgram:
    """The program of a file; ProblemFileError says in one sentence what is wrong with the file."""
    suffix = path.suffix.lower()
    with about(path):
        require(suffix in READERS, f"unknown suffix {path.suffix!r}; a program is in {', '.join(READERS)}")
        return READERS[suffix](path)
