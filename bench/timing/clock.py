"""Timing calls that take microseconds.

Each call is timed by itself with the monotonic nanosecond clock and the raw figures are kept; garbage collection is
off while they are taken. Data are others at every call, and an answer is copied as an array of our own inside its time:
what is lazy does its work there, and what is a view cannot change afterwards. The clock and the copy are taken when
this module is imported, which is before any solver's file is.
"""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter_ns
from typing import Annotated

import numpy as np
from msgspec import Meta

from solvers.protocol import Matrix, Nanoseconds, Solver, Vector

LONG_NS = 100_000_000
"""A longer call is timed once."""


@dataclass(frozen=True)
class Effort:
    """How long one thing is timed: until ``budget_s`` is spent, but between ``fewest`` and ``most`` calls; once in any
    case, and not again after LONG_NS."""

    budget_s: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.03
    fewest: Annotated[int, Meta(ge=1)] = 3
    most: Annotated[int, Meta(ge=1)] = 300

    def goes_on(self, done: int, spent_ns: int) -> bool:
        """Whether to time once more after so many calls and nanoseconds."""
        return done == 0 or spent_ns < (
            LONG_NS if done < self.fewest else self.budget_s * 1e9 if done < self.most else 0.0
        )


@dataclass(frozen=True)
class Timed:
    """Raw nanoseconds of updates and solves, shape (n,), and the answers (n, d) that were timed, NaN for one of another
    shape."""

    updates: Nanoseconds
    solves: Nanoseconds
    answers: Matrix


@contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Keep the collector from running inside a timed block."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def time_call(call: Callable[[], object], clock: Callable[[], int] = perf_counter_ns) -> int:
    """Nanoseconds of one call."""
    start = clock()
    call()
    return clock() - start


def time_block(
    solver: Solver,
    P: Matrix,
    q: Matrix,
    start: Vector | None = None,
    most_ns: float = np.inf,
    clock: Callable[[], int] = perf_counter_ns,
    copied: Callable[..., Vector] = np.array,
) -> Timed:
    """Time update, and solve with the copy of its answer, for each P (n, d, d) and q (n, d); cold, or from ``start``
    (d,).

    After the call at which ``most_ns`` are spent no other begins.
    """
    update, solve, keywords = solver.update, solver.solve, {} if start is None else {"warm_start": start}
    updates, solves, answers, left_ns = [], [], np.full(q.shape, np.nan), most_ns
    with no_garbage_collection():
        for k in range(len(q)):
            Pk, qk = P[k], q[k]
            begin = clock()
            update(P=Pk, q=qk)
            between = clock()
            x = copied(solve(**keywords))
            end = clock()
            updates.append(between - begin)
            solves.append(end - between)
            _keep(answers[k], x)  # and not x itself, for which each call would take a new page of memory
            left_ns -= end - begin
            if left_ns < 0:
                break
    return Timed(np.array(updates, dtype=np.int64), np.array(solves, dtype=np.int64), answers[: len(solves)])


def time_kernel(solver: Solver, P: Matrix, q: Matrix, start: Vector | None = None, most_ns: float = np.inf) -> Timed:
    """The same timed inside compiled code, into which the data go as they are."""
    with no_garbage_collection():
        return Timed(*solver.time_kernel(P, q, start, most_ns))


def _keep(row: Vector, x: Vector) -> None:
    """Copy an answer into its row, where it is of the right shape and made of real numbers."""
    if x.shape == row.shape and x.dtype.kind in "fiu":
        row[:] = x
