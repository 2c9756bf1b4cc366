"""Timing calls that take microseconds.

Each call is timed by itself with the monotonic nanosecond clock and the raw figures are kept; garbage collection is
off while they are taken. What is done between two timed calls (new data for the solver, say) is not in the figure.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter_ns
from typing import Annotated

import numpy as np
from msgspec import Meta

from solvers.protocol import Nanoseconds, Solver, Vector

LONG_NS = 100_000_000
"""After which a call is not timed again, however few times there are."""


@dataclass(frozen=True)
class Effort:
    """How long one thing is timed: until ``budget_s`` is spent, but between ``fewest`` and ``most`` calls; once in any case, and
    not again after LONG_NS."""

    budget_s: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.03
    fewest: Annotated[int, Meta(ge=1)] = 3
    most: Annotated[int, Meta(ge=1)] = 300

    def goes_on(self, done: int, spent_ns: int) -> bool:
        """Whether to time once more after so many calls and nanoseconds."""
        return done == 0 or spent_ns < (LONG_NS if done < self.fewest else self.budget_s * 1e9 if done < self.most else 0.0)


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


def time_call(call: Callable[[], object]) -> int:
    """Nanoseconds of one call."""
    start = perf_counter_ns()
    call()
    return perf_counter_ns() - start


def time_pairs(update: Callable[[], object], solve: Callable[[], object], effort: Effort,
               ) -> tuple[Nanoseconds, Nanoseconds]:
    """Time update and solve in turns, so that every solve starts from new data; raw nanoseconds of both."""
    updates: list[int] = []
    solves: list[int] = []
    spent = 0
    with no_garbage_collection():
        while effort.goes_on(len(solves), spent):
            updates.append(time_call(update))
            solves.append(time_call(solve))
            spent += updates[-1] + solves[-1]
    return np.array(updates, dtype=np.int64), np.array(solves, dtype=np.int64)


def time_kernel(solver: Solver, update: Callable[[], object], effort: Effort, warm_start: Vector | None = None,
                ) -> tuple[Nanoseconds, Nanoseconds]:
    """Time update and solve inside compiled code; updates that are not compiled are timed from Python."""
    start = {} if warm_start is None else {"warm_start": warm_start}
    updates: list[Nanoseconds] = []
    solves: list[Nanoseconds] = []
    spent, done = 0, 0
    with no_garbage_collection():
        while effort.goes_on(done, spent):
            compiled, taken = solver.time_kernel(effort.fewest, **start)
            updates.append(np.array([time_call(update)], dtype=np.int64) if compiled is None else compiled)
            solves.append(taken)
            spent += int(taken.sum() + updates[-1].sum())
            done += taken.size
    return np.concatenate(updates), np.concatenate(solves)
