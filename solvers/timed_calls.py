"""Python's side of the compiled loop that times a solver, ``solvers/core/timed_calls.h``."""

from collections.abc import Callable

import numpy as np

from solvers.arrays import Matrix, Nanoseconds, Vector

Timings = tuple[Nanoseconds, Nanoseconds, Matrix]
"""Nanoseconds of updates and of solves, (n,) each, and answers (n, d), NaN if a library found none."""
LONGEST_NS = 2**62


def time_calls(
    loop: Callable[..., int],
    P: Matrix | None,
    q: Matrix,
    warm_start: Vector | None,
    most_ns: float,
) -> tuple[int, Timings]:
    """Run a function of the core whose last arguments are those of ``TIMED`` in ``bindings_timed.h``.

    The other parameters are those of :meth:`solvers.protocol.Solver.time_kernel`, checked. Returns the status of the
    last call and the timings.
    """
    n, d = q.shape
    updates, solves, answers = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64), np.full((n, d), np.nan)
    made, longest = np.zeros(1, dtype=np.int64), int(min(most_ns, LONGEST_NS))
    status = loop(q, None if P is None else P.reshape(n, d * d), warm_start, longest, updates, solves, answers, made)
    return status, (updates[: made[0]], solves[: made[0]], answers[: made[0]])
