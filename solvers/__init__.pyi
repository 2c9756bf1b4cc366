from .protocol import Lane, Problem, Solver, Unsupported
from .registry import Described, Entry, add_file, available, describe, entries, find, from_file, get

__all__ = [
    "Described",
    "Entry",
    "Lane",
    "Problem",
    "Solver",
    "Unsupported",
    "add_file",
    "available",
    "describe",
    "entries",
    "find",
    "from_file",
    "get",
]
