from .batch import BoxBatch
from .protocol import Lane, Solver, Status, Tier, Unsupported
from .registry import add_file, available, describe, entries, find, from_file, get

__all__ = [
    "BoxBatch",
    "Lane",
    "Solver",
    "Status",
    "Tier",
    "Unsupported",
    "add_file",
    "available",
    "describe",
    "entries",
    "find",
    "from_file",
    "get",
]
