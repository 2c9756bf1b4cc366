"""Proofs of programs that come from anywhere, several at once, each within so much work.

Nobody promises that a foreign program is convex, feasible, bounded or small, nor that the library that is asked for a
start survives it, so each proof is found in a process of its own. Work is counted in bit operations: what can be proven
does not hang on the load of a machine.
"""

import time
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from queue import SimpleQueue
from typing import Any, TypeVar

import numpy as np
import qpsolvers
from qpsolvers import Problem
from qpsolvers.exceptions import QPError
from scipy.sparse import csc_matrix

from bench.processes.forked_child import ForkedChild
from bench.timing import cores
from piezo_model.child_process import LateError, LostError
from solvers.arrays import Vector
from solvers.certificate import Certificate, NotCertified, certify

S = TypeVar("S")
T = TypeVar("T")

LARGEST = 4_000_000
"""Elements of the dense optimality system that a proof starts with; each becomes an integer of many digits."""
STARTERS = ("clarabel", "piqp", "highs", "daqp", "quadprog")
"""Solvers that are asked for a start, the first that is installed; the proof does not depend on it."""


class ProverLost(NotCertified):
    """The process that looked for a proof died, which may be the machine's doing."""


HANG_S = 3600.0
"""Seconds after which a library that was asked for a start hangs; no proof takes so long."""


def prove(child: ForkedChild, function: Callable[..., T], *arguments: Any) -> T:
    """Call a function of a module in a process that looks for proofs; it starts again after it was lost.

    Raises
    ------
    NotCertified
        As the function raises it, or because the process died.
    """
    try:
        found = child.call(HANG_S, _attempt, function, arguments)
    except (LateError, LostError) as error:
        raise ProverLost(f"the process that looked for a proof ended with {error}") from None
    if isinstance(found, NotCertified):
        raise found
    return found


def proven(function: Callable[[ForkedChild, S], T], items: Iterable[S]) -> Generator[T]:
    """What a function returns for each item, in their order, with a process a core that looks for proofs; begun are
    only a few more than are asked for.

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

        threads, begun = ThreadPoolExecutor(len(children)), deque[Future[T]]()

        def first() -> T:
            found = begun[0].result()
            begun.popleft()  # and not before: what is waited for is ended, too, where the wait is interrupted
            return found

        try:
            for item in items:
                begun.append(threads.submit(with_child, item))
                if len(begun) > 2 * len(children):
                    yield first()
            while begun:
                yield first()
        finally:
            threads.shutdown(wait=False, cancel_futures=True)
            while not all(future.done() for future in begun):
                for child in children:
                    child.interrupt()  # a process that is just starting is ended in a later round
                time.sleep(0.02)
            threads.shutdown()


def _attempt(function: Callable[..., T], arguments: tuple[Any, ...]) -> T | NotCertified:
    """What a function returns, or why there is no proof."""
    try:
        return function(*arguments)
    except (NotCertified, ValueError) as error:  # ValueError: NaN or a shape, in the program's data
        return NotCertified(str(error))
    except MemoryError:
        return NotCertified("the proof needs more memory than there is")


def require_size(qp: Problem) -> None:
    """NotCertified where a program is too large to be written down densely."""
    d = qp.q.size
    rows = d + sum(right.size for right in (qp.h, qp.b) if right is not None)
    if rows * d > LARGEST:
        raise NotCertified(f"{d} variables with {rows - d} rows are too many for exact arithmetic, which is dense")


def both_proofs(raw: Problem, scaled: Problem, unit: Vector, work: float) -> tuple[Certificate, Certificate]:
    """Certificates of a program and of the same one in z, x = ``unit`` · z.

    Raises
    ------
    NotCertified
        Not convex, infeasible, unbounded, or too much work.
    """
    proof = certify(raw, unit * start(scaled), work=work)
    return proof, certify(scaled, np.array(proof.x) / unit, work=work)


def start(qp: Problem) -> Vector:
    """Some solver's answer (d,), or zeros."""
    matrices = [None if M is None else csc_matrix(M) for M in (qp.P, qp.G, qp.A)]
    for solver in STARTERS:
        if solver in qpsolvers.available_solvers:
            P, G, A = (
                matrices
                if solver in qpsolvers.sparse_solvers
                else (None if M is None else M.toarray() for M in matrices)
            )
            try:
                with warnings.catch_warnings(action="ignore"):  # of a solver that has no answer
                    x = qpsolvers.solve_problem(Problem(P, qp.q, G, qp.h, A, qp.b, qp.lb, qp.ub), solver=solver).x
            except QPError:  # says why it has no start; the next one may have one
                continue
            if x is not None and np.all(np.isfinite(x)):
                return np.asarray(x, dtype=np.float64)
    return np.zeros(qp.q.size)
