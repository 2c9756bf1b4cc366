"""Proofs of programs that come from anywhere, within a time limit.

Exact arithmetic takes as long as it takes and cannot be interrupted from within, so it works in a process of its own that
can be ended. Nobody promises that a foreign program is convex, feasible, bounded or small.
"""

from __future__ import annotations

import multiprocessing
import signal
import warnings
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


class Prover:
    """A process that calls functions for us, each within the time limit; another one starts after it was ended.

    Parameters
    ----------
    limit_s : float
        Seconds for one call.
    """

    def __init__(self, limit_s: float) -> None:
        self.limit_s = limit_s
        self._process: Any = None
        self._connection: Connection | None = None

    def call(self, function: Callable[..., T], *arguments: Any) -> T:
        """Call a function of a module.

        Raises
        ------
        NotCertified
            As the function raises it, or because the time is over or the process died.
        """
        connection = self._connection or self._start()
        try:
            connection.recv()  # that it is ready: to import everything is no part of a proof
            connection.send((function, arguments))
            if not connection.poll(self.limit_s):
                self.close()
                raise NotCertified(f"no proof within {self.limit_s:g} s")
            found = connection.recv()
        except (EOFError, OSError):
            self._process.join(GRACE_S)
            status = self._process.exitcode
            self.close()
            raise NotCertified(f"the process that looked for a proof ended with status {status}") from None
        if isinstance(found, Exception):
            raise NotCertified(str(found))
        return found  # type: ignore[no-any-return]

    def _start(self) -> Connection:
        context = multiprocessing.get_context("forkserver")
        connection, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other, self.limit_s), daemon=True)
        self._process.start()
        other.close()
        self._connection = connection
        return connection

    def close(self) -> None:
        """End the process, if there is one."""
        if self._connection is not None:
            self._process.kill()
            self._process.join()
            self._connection.close()
            self._connection = None

    def __enter__(self) -> Prover:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _serve(connection: Connection, limit_s: float) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent to deal with
    while True:
        connection.send("ready")
        try:
            function, arguments = connection.recv()
        except EOFError:
            return
        signal.setitimer(signal.ITIMER_REAL, limit_s + GRACE_S)  # should the parent be gone by then
        try:
            connection.send(function(*arguments))
        except (NotCertified, ValueError) as error:  # ValueError: NaN or a shape, in the program's data
            connection.send(NotCertified(str(error)))
        except MemoryError:
            connection.send(NotCertified("the proof needs more memory than there is"))
        signal.setitimer(signal.ITIMER_REAL, 0.0)


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
                with warnings.catch_warnings(action="ignore"):  # of a solver that has no answer
                    x = qpsolvers.solve_problem(Problem(P, qp.q, G, qp.h, A, qp.b, qp.lb, qp.ub), solver=solver).x
            except QPError:  # says why it has no start; the next one may have one
                continue
            if x is not None and np.all(np.isfinite(x)):
                return np.asarray(x, dtype=np.float64)
    return np.zeros(qp.q.size)
