from .engine import Workers
from .forked_child import warm_up
from .sentinel import EVERY_S
from .solver_child import SolverPool, entry_of_file

__all__ = [
    "EVERY_S",
    "SolverPool",
    "Workers",
    "entry_of_file",
    "warm_up",
]
