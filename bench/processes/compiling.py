"""Compiling our own solvers before anything is timed.

Numba compiles at first use, for half a minute in all on a fresh machine, and keeps the machine code on disk. Here that is done once
in the parent, so that no task's time limit has to cover it and no two children do it at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from qpsolvers import Problem

from solvers.protocol import Solver
from solvers.registry import Entry

OURS = "solvers.kernel."


def compile_solvers(entries: Sequence[Entry], progress: Callable[[str, int, int], None] = lambda what, done, total: None,
                    rows: bool = False) -> None:
    """Use each of our compiled solvers among the entries once, in every way that a race does; with ``rows`` as a stream does, too."""
    ours = {entry.module: entry for entry in entries if entry.module.startswith(OURS)}
    for done, entry in enumerate(ours.values()):
        progress(f"{entry.name}, which is compiled when it is used for the first time", done, len(ours))
        P, q = np.eye(2), -np.ones(2)
        solver = entry.load()()
        solver.setup(Problem(P, q, lb=np.zeros(2)))
        solver.update(P=P, q=q)
        solver.solve()
        solver.time_kernel(1)
        if rows and type(solver).time_rows is not Solver.time_rows:
            solver.time_rows(np.ones((1, 3)), 1.0)
