"""Quadratic programs in files: one module per format; :func:`read` selects it by the suffix."""

from collections.abc import Callable, Mapping
from pathlib import Path

from bench.problem_files.mat import read_mat
from bench.problem_files.npz import read_npz
from bench.problem_files.program import ProblemFileError, ReadProgram, about, check
from bench.problem_files.qps import read_qps

__all__ = ["READERS", "ProblemFileError", "ReadProgram", "read", "suffix_of"]

READERS: Mapping[str, Callable[[Path], ReadProgram]] = {
    ".npz": read_npz,
    ".mat": read_mat,
    **dict.fromkeys((".qps", ".mps", ".sif", ".qps.gz", ".mps.gz", ".sif.gz"), read_qps),
}
"""Reader by lower-case suffix; it raises ValueError for an invalid file, without the file's name."""


def suffix_of(path: Path) -> str:
    """The lower-case suffix of a file, with the one before it if that is .gz.

    Examples
    --------
    >>> suffix_of(Path("HS21.QPS")), suffix_of(Path("no.1.sif.gz"))
    ('.qps', '.sif.gz')
    """
    return "".join(path.suffixes[-2 if path.suffix.lower() == ".gz" else -1 :]).lower()


def read(path: Path) -> ReadProgram:
    """The program in a file; ProblemFileError for an invalid file."""
    with about(path):
        check(path.is_file() or not path.exists(), "is not a regular file")  # a pipe would be waited for
        check(suffix_of(path) in READERS, f"unknown suffix {suffix_of(path)!r}; a program is in {', '.join(READERS)}")
        return READERS[suffix_of(path)](path)
