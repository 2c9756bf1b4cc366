"""Proofs of programs that come from anywhere, within a time limit.

Exact arithmetic takes as long as it takes and cannot be interrupted from within, so it works in a process of its own that
can be ended. Nobody promises that a foreign program is convex, feasible, bounded or small.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import qpsolvers
from numpy.typing import NDArray
from qpsolvers import Problem
from qpsolvers.exceptions import QPError
from scipy.sparse import csc_matrix

from bench.processes.child import START_LIMIT_S, Child, LateError, LostError
from solvers.certificate import Certificate, NotCertified, certify

Vector = NDArray[np.float64]
T = TypeVar("T")

LARGEST = 4_000_000
"""Elements of the dense optimality system that a proof starts with; each becomes an integer of many digits."""
STARTERS = ("clarabel", "piqp", "highs", "daqp", "quadprog")
"""Solvers that are asked for a start, the first that is installed; the proof does not depend on it."""


class Prover(Child):
    """A process that looks for proofs, each within the time limit; another one starts after it was ended.

    Parameters
    ----------
    limit_s : float
        Seconds for one proof.
    """

    def __init__(self, limit_s: float) -> None:
        super().__init__()
        self.limit_s = limit_s

    def prove(self, function: Callable[..., T], *arguments: Any) -> T:
        """Call a function of a module.

        Raises
        ------
        NotCertified
            As the function raises it, or because the time is over or the process died.
        """
        try:
            if not self.is_running:
                self.call(START_LIMIT_S, _imported)  # which is no part of a proof
            found = self.call(self.limit_s, _attempt, function, arguments)
        except LateError:
            raise NotCertified(f"no proof within {self.limit_s:g} s") from None
        except LostError as error:
            raise NotCertified(f"the process that looked for a proof ended with {error}") from None
        if isinstance(found, NotCertified):
            raise found
        return found


def _imported() -> None:
    """To find this in a process takes importing everything."""


def _attempt(function: Callable[..., T], arguments: tuple[Any, ...]) -> T | NotCertified:
    """What a function returns, or why there is no proof."""
    try:
        return function(*arguments)
    except (NotCertified, ValueError) as error:  # ValueError: NaN or a shape, in the program's data
        return NotCertified(str(error))
    except MemoryError:
        return NotCertified("the proof needs more memory than there is")


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
