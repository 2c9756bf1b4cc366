"""Proofs of programs that come from anywhere, within a time limit.

Exact arithmetic takes as long as it takes and cannot be interrupted from within, so it works in a process of its own that
can be ended. Nobody promises that a foreign program is convex, feasible, bounded or small.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, TypeVar

import numpy as np
import qpsolvers
from numpy.typing import NDArray
from qpsolvers import Problem
from qpsolvers.exceptions import QPError
from scipy.sparse import csc_matrix

from solvers.certificate import Certificate, NotCertified, certify

Vector = NDArray[np.float64]
T = TypeVar("T")

LARGEST = 4_000_000
"""Elements of the dense optimality system that a proof starts with; each becomes an integer of many digits."""
STARTERS = ("clarabel", "piqp", "highs", "daqp", "quadprog")
"""Solvers that are asked for a start, the first that is installed; the proof does not depend on it."""
GRACE_S = 3.0


def within(limit_s: float, function: Callable[..., T], *arguments: Any) -> T:
    """Call a function of a module in a process of its own.

    Raises
    ------
    NotCertified
        As the function raises it, or because the time is over or the process died.
    """
    context = multiprocessing.get_context("forkserver")
    connection, other = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(other, limit_s, function, arguments), daemon=True)
    process.start()
    other.close()
    try:
        if not connection.poll(limit_s):
            raise NotCertified(f"no proof within {limit_s:g} s")
        found = connection.recv()
    except EOFError:
        process.join(GRACE_S)
        raise NotCertified(f"the process that looked for a proof ended with status {process.exitcode}") from None
    finally:
        process.kill()
        process.join()
        connection.close()
    if isinstance(found, Exception):
        raise NotCertified(str(found))
    return found  # type: ignore[no-any-return]


def _answer(connection: Connection, limit_s: float, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent to deal with
    signal.setitimer(signal.ITIMER_REAL, limit_s + GRACE_S)  # should the parent be gone by then
    try:
        connection.send(function(*arguments))
    except (NotCertified, ValueError) as error:  # ValueError: NaN or a shape, in the program's data
        connection.send(error)
    except MemoryError:
        connection.send(NotCertified("the proof needs more memory than there is"))


def both_proofs(raw: Problem, scaled: Problem, unit: Vector) -> tuple[Certificate, Certificate]:
    """Certificates of a program and of the same one in z, x = ``unit`` · z.

    Raises
    ------
    NotCertified
        Too large, not convex, infeasible, unbounded, or too many pivots.
    """
    d = raw.q.size
    rows = d + sum(right.size for right in (raw.h, raw.b) if right is not None)
    if rows * d > LARGEST:
        raise NotCertified(f"{d} variables with {rows - d} rows are too many for exact arithmetic, which is dense")
    proof = certify(raw, unit * start(scaled))
    return proof, certify(scaled, np.array(proof.x) / unit)


def start(qp: Problem) -> Vector:
    """Some solver's answer (d,), or zeros."""
    matrices = [None if M is None else csc_matrix(M) for M in (qp.P, qp.G, qp.A)]
    for solver in STARTERS:
        if solver in qpsolvers.available_solvers:
            P, G, A = matrices if solver in qpsolvers.sparse_solvers else (
                None if M is None else M.toarray() for M in matrices)
            try:
                x = qpsolvers.solve_problem(Problem(P, qp.q, G, qp.h, A, qp.b, qp.lb, qp.ub), solver=solver).x
            except QPError:  # says why it has no start; the next one may have one
                continue
            if x is not None and np.all(np.isfinite(x)):
                return np.asarray(x, dtype=np.float64)
    return np.zeros(qp.q.size)
