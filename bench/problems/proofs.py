"""The certifier of all problem sets: exact proofs of optima, cached between calls under a hash of the program's data.

A proof begins at the approximate answer of a solver, on which it does not depend. It is kept in the user's cache, one
JSON file for each program, and verified when it is read, so a damaged or foreign file costs time and nothing else. A
failed proof is cached too, with the reason and the allowed work; neither depends on the machine.
"""

import hashlib
import json
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
import qpsolvers
from qpsolvers import Problem
from qpsolvers.exceptions import QPError

import solvers
from bench.messages import user_cache
from piezo_model import json_file
from piezo_model.atomic_file import write_text
from solvers.arrays import Vector
from solvers.certificate import WORK, Certificate, NotCertified, certify, verify
from solvers.exact.problem import DoubleProblem

VERSION = 3
"""Cache version; raise it when the format of a proof or what is refused changes."""
STARTERS = ("clarabel", "piqp", "highs", "daqp", "quadprog")
"""Solvers that compute a start, in order of preference, for programs with more than bounds."""


@dataclass(frozen=True)
class CachedProof:
    """Content of a file: the proof, or the reason why there is none."""

    proof: Certificate | None
    refusal: str = ""


def start(qp: Problem) -> Vector:
    """A solver's approximate answer (d,), or zeros."""
    if qp.G is None and qp.A is None and isinstance(qp.P, np.ndarray):
        solver = solvers.get("box_active_set")
        with suppress(ValueError):  # it refuses an unbounded program, and the proof says why
            solver.setup(qp)
            answer = np.array(solver.solve())
            return answer if np.isfinite(answer).all() else np.zeros(qp.q.size)
    for name in STARTERS:
        if name in qpsolvers.available_solvers:
            try:
                with warnings.catch_warnings(action="ignore"):  # of converted matrices and missing answers
                    x = qpsolvers.solve_problem(qp, name).x
            except QPError:  # the next solver may have an answer
                continue
            if x is not None and np.isfinite(x).all():
                return np.asarray(x, dtype=np.float64)
    return np.zeros(qp.q.size)


def proof(qp: Problem, begin: Callable[[Problem], Vector] = start, work: float = WORK) -> Certificate:
    """The certificate of a program, from the cache if it holds one that is right.

    Parameters
    ----------
    qp : qpsolvers.Problem
    begin : callable
        Finds the answer (d,) from which the proof starts.
    work : float
        Limit of the work in bit operations, see :func:`solvers.certificate.certify`.

    Raises
    ------
    NotCertified
        There is no proof, or the program's data hold NaN or have a wrong shape.

    Examples
    --------
    >>> proof(Problem(np.eye(1), -np.ones(1), lb=np.zeros(1))).value
    '-1/2'
    """
    try:
        data = DoubleProblem.of(qp).fingerprint
    except ValueError as error:
        raise NotCertified(str(error)) from None
    key = hashlib.sha256(json.dumps([VERSION, work, data]).encode()).hexdigest()
    path = user_cache.folder("proofs") / f"{key}.json"
    try:
        cached = json_file.read(path, CachedProof)
        if cached.proof is not None:
            verify(qp, cached.proof)
        elif not cached.refusal:
            raise ValueError(f"{path} holds neither a proof nor a reason")
    except (ValueError, NotCertified):  # no file, a damaged one, or that of another program
        try:
            cached = CachedProof(certify(qp, begin(qp), work=work))
        except NotCertified as error:
            cached = CachedProof(None, str(error))
        user_cache.keep(path, partial(write_text, text=json.dumps(asdict(cached))))
    if cached.proof is None:
        raise NotCertified(cached.refusal)
    return cached.proof
