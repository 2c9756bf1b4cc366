"""Foreign programs are read and proven in processes of their own, several in parallel, each within a limit on its work.

A foreign program may be nonconvex, infeasible, unbounded or huge, and may crash the library that reads it or computes
the start.
Work is counted in bit operations, so that the result does not depend on the load of the machine.
"""

import time
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from queue import SimpleQueue
from typing import Any, TypeVar

from qpsolvers import Problem

from bench.processes.forked_child import ForkedChild
from bench.timing import cores
from piezo_model.child_process import LateError, LostError
from solvers.certificate import NotCertified

S = TypeVar("S")
T = TypeVar("T")

LARGEST = 4_000_000
"""Largest number of elements of a proof's dense optimality system; each becomes an integer of many digits."""
HANG_S = 3600.0
"""Time limit for the library that computes a start; no proof takes that long."""


class ProverLost(Exception):
    """The proving process died, possibly for a reason outside the program."""


def prove(child: ForkedChild, function: Callable[..., T], *arguments: Any) -> T:
    """Call a function of a module in a proving process, which is restarted if it was lost.

    Raises
    ------
    NotCertified
        As the function raises it.
    ProverLost
        The process died.
    """
    try:
        result = child.call(HANG_S, _attempt, function, arguments)
    except (LateError, LostError) as error:
        raise ProverLost(f"the proving process ended with {error}") from None
    if isinstance(result, NotCertified):
        raise result
    return result


def proven(function: Callable[[ForkedChild, S], T], items: Iterable[S]) -> Generator[T]:
    """The function's results in the order of the items, with one proving process per core; closing the generator ends
    the processes.

    Examples
    --------
    >>> list(proven(lambda child, number: number + 1, range(4)))
    [1, 2, 3, 4]
    """
    with ExitStack() as stack:
        children = [stack.enter_context(ForkedChild()) for _ in cores.usable()]
        idle: SimpleQueue[ForkedChild] = SimpleQueue()
        for child in children:
            idle.put(child)

        def with_child(item: S) -> T:
            child = idle.get()
            try:
                return function(child, item)
            finally:
                idle.put(child)

        threads = ThreadPoolExecutor(len(children))
        futures = [threads.submit(with_child, item) for item in items]
        try:
            for future in futures:
                yield future.result()
        finally:
            threads.shutdown(wait=False, cancel_futures=True)
            while not all(future.done() for future in futures):
                for child in children:
                    child.interrupt()  # has no effect on a process that is just starting, so it is repeated
                time.sleep(0.02)
            threads.shutdown()


def _attempt(function: Callable[..., T], arguments: tuple[Any, ...]) -> T | NotCertified:
    """The result of a function, or the reason why there is no proof."""
    try:
        return function(*arguments)
    except NotCertified as error:
        return error
    except ValueError as error:  # NaN or a wrong shape in the program's data
        return NotCertified(str(error))
    except MemoryError:
        return NotCertified("the proof needs more memory than there is")


def require_size(qp: Problem) -> None:
    """NotCertified if a program is too large for dense matrices."""
    d = qp.q.size
    rows = d + sum(right.size for right in (qp.h, qp.b) if right is not None)
    if rows * d > LARGEST:
        raise NotCertified(f"{d} variables with {rows - d} rows are too many for exact arithmetic, which is dense")
