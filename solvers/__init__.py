"""Quadratic programs and everything that solves them; knows nothing of piezo actuators."""

from solvers.protocol import Lane, Solver, Status, Tier, Unsupported
from solvers.registry import add_file, available, describe, entries, find, from_file, get

__all__ = ["Lane", "Solver", "Status", "Tier", "Unsupported", "add_file", "available", "describe", "entries", "find", "from_file",
           "get"]
