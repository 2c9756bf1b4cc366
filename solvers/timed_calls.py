"""The compiled loop that times a solver, as Python calls it; it stands in ``solvers/core/timed_calls.h``."""

from collections.abc import Callable
from typing import Any

import numpy as np

from solvers.arrays import Matrix, Nanoseconds, Vector

Timings = tuple[Nanoseconds, Nanoseconds, Matrix]
"""Nanoseconds of updates and of solves, (n,) each, and the answers (n, d), NaN where a library found none."""
LONGEST_NS = 2**62


def time_calls(
    loop: Callable[..., int],
    P: Matrix,
    q: Matrix,
    warm_start: Vector | None,
    most_ns: float,
) -> tuple[int, Timings]:
    """Run a function of the core that ends in the arguments of ``bindings_timed.h``, ``loop``; the status of the last
    call, and what was timed.

    Parameters are those of :meth:`solvers.protocol.Solver.time_kernel`.
    """
    n, d = q.shape
    start = None if warm_start is None else np.array(warm_start, dtype=np.float64)
    updates, solves, answers = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64), np.full((n, d), np.nan)
    made, longest = np.zeros(1, dtype=np.int64), int(min(most_ns, LONGEST_NS))
    status = loop(_contiguous(q), _contiguous(P).reshape(n, d * d), start, longest, updates, solves, answers, made)
    return status, (updates[: made[0]], solves[: made[0]], answers[: made[0]])


def follow_rows(
    loop: Callable[..., int], P: Matrix, q: Vector, rows: Matrix, forgetting: float
) -> tuple[int, Matrix, Nanoseconds]:
    """Run a function of the core that follows rows, which come into P (d, d) and q (d,); the last status, answers, and
    what was timed.

    Parameters are those of :meth:`solvers.protocol.Solver.time_rows`.
    """
    answers, nanoseconds = np.full((len(rows), q.size), np.nan), np.zeros(len(rows), dtype=np.int64)
    return loop(P, q, _contiguous(rows), forgetting, answers, nanoseconds), answers, nanoseconds


def _contiguous(data: Any) -> Matrix:
    return np.ascontiguousarray(data, dtype=np.float64)
