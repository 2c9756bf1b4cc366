"""Timing calls that take microseconds.

Each call is timed separately with the monotonic nanosecond clock, without garbage collection, and the raw times are
kept. Every call has new data, and the answer is copied within its time: a lazy object does its work there, and a view
cannot change afterwards. The clock and the copy are bound when this module is imported, before any solver's file.
"""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter_ns
from typing import Annotated

import numpy as np
from msgspec import Meta

from solvers.protocol import Matrix, Nanoseconds, Solver, Timings, Vector

LONG_NS = 100_000_000
"""A longer call is timed once."""
LEAST_SHARE = 2.0 / 3.0
"""Least time of an answer, in processor times of a call."""


@dataclass(frozen=True)
class Effort:
    """Number of timed calls: until ``budget_s`` is spent, but between ``fewest`` and ``most``; at least one, and none
    after LONG_NS."""

    budget_s: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.03
    fewest: Annotated[int, Meta(ge=1)] = 3
    most: Annotated[int, Meta(ge=1)] = 300

    def goes_on(self, done: int, spent_ns: int) -> bool:
        """Whether to time another call, after ``done`` calls and ``spent_ns``."""
        return done == 0 or spent_ns < (
            LONG_NS if done < self.fewest else self.budget_s * 1e9 if done < self.most else 0.0
        )


def answers_us(update_ns: Nanoseconds, solve_ns: Nanoseconds, cpu_us: float = np.nan) -> Vector:
    """The time of each answer in µs, shape (n,): update and solve of the same call, and no less than LEAST_SHARE of
    ``cpu_us``, the processor time of a call where that is known.

    Every table, plot, sentence and decision takes the time of an answer from here.

    Examples
    --------
    >>> answers_us(np.array([1000, 2000]), np.array([500, 6000]), cpu_us=6.0)
    array([4., 8.])
    """
    return np.fmax((update_ns + solve_ns) / 1e3, LEAST_SHARE * cpu_us)


@contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Switch the garbage collector off inside a timed block."""
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
    P: Matrix | None,
    q: Matrix,
    start: Vector | None = None,
    most_ns: float = np.inf,
    clock: Callable[[], int] = perf_counter_ns,
    copied: Callable[..., Vector] = np.array,
) -> Timings:
    """Time update, and solve with the copy of its answer, for each P (n, d, d), None if it is fixed, and q (n,
    d); cold, or from ``start`` (d,). No call begins after ``most_ns`` are spent. The row of an answer of another shape
    is NaN."""
    update, solve, keywords = solver.update, solver.solve, {} if start is None else {"warm_start": start}
    updates, solves, answers, remaining_ns = [], [], np.full(q.shape, np.nan), most_ns
    with no_garbage_collection():
        for k in range(len(q)):
            Pk, qk = None if P is None else P[k], q[k]
            begin = clock()
            update(P=Pk, q=qk)
            between = clock()
            x = copied(solve(**keywords))
            end = clock()
            updates.append(between - begin)
            solves.append(end - between)
            if x.shape == answers[k].shape and x.dtype.kind in "fiu":
                answers[k] = x  # in one array, since keeping x would take a new page of memory at each call
            remaining_ns -= end - begin
            if remaining_ns < 0:
                break
    return np.array(updates, dtype=np.int64), np.array(solves, dtype=np.int64), answers[: len(solves)]


def time_kernel(
    solver: Solver, P: Matrix | None, q: Matrix, start: Vector | None = None, most_ns: float = np.inf
) -> Timings:
    """The same with the clock inside compiled code, which gets the data unchanged."""
    with no_garbage_collection():
        return solver.time_kernel(P, q, start, most_ns)
