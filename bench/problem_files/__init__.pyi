from .npz import opened, packed, packed_program, unpacked, unpacked_program
from .program import ProblemFileError, ReadProgram, about, checked, doubles, require
from .qpbenchmark_set import read_test_set
from .reading import READERS, read, suffix_of

__all__ = [
    "READERS",
    "ProblemFileError",
    "ReadProgram",
    "about",
    "checked",
    "doubles",
    "opened",
    "packed",
    "packed_program",
    "read",
    "read_test_set",
    "require",
    "suffix_of",
    "unpacked",
    "unpacked_program",
]
