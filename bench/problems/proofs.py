"""The certifier of all problem sets: exact proofs of optima, cached between calls under a hash of the program's data.

A proof begins at the approximate answer of a solver, on which it does not depend. It is kept in the user's cache, one
JSON file for each program, and verified when it is read, so a damaged or foreign file costs time and nothing else. A
failed proof is cached too, with the reason and the allowed work; neither depends on the machine.

A foreign program may be nonconvex, infeasible, unbounded or huge, and may crash the library that reads it or computes
the start. So it is read and proven in a process of its own, several in parallel, each within a limit on its work, which
is counted in bit operations, so that the result does not depend on the load of the machine.
"""

import hashlib
import json
import time
import warnings
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict
from typing import Any, TypeVar

import numpy as np
import qpsolvers
from qpsolvers import Problem
from qpsolvers.exceptions import QPError

import solvers
from bench.messages import user_cache
from bench.processes.child_process import Child, LostError
from bench.timing import cores
from piezo_model import json_file
from piezo_model.checks import check, refusing
from solvers.arrays import Vector
from solvers.certificate import WORK, Certificate, NotCertified, certify, verify
from solvers.exact.problem import DoubleProblem

T = TypeVar("T")

VERSION = 5
"""Cache version; raise it when the format of a proof or what is refused changes."""
STARTERS = ("clarabel", "piqp", "highs", "daqp", "quadprog")
"""Solvers that compute a start, in order of preference, for programs with more than bounds."""
LARGEST = 4_000_000
"""Largest number of elements of a proof's dense optimality system; each becomes an integer of many digits."""
CACHED: Any = Certificate | str
"""Content of a file: the proof, or the reason why there is none."""
HANG_S = 3600.0
"""Time limit of a call; no proof takes that long."""


def start(qp: Problem) -> Vector:
    """A solver's approximate answer (d,), or zeros."""
    if qp.G is None and qp.A is None and isinstance(qp.P, np.ndarray):
        solver = solvers.get("box_active_set")
        with suppress(ValueError):  # it refuses an unbounded program, and the proof says why
            solver.setup(qp)
            return np.nan_to_num(solver.solve())
    for name in (each for each in STARTERS if each in qpsolvers.available_solvers):
        # the next solver may have an answer; it warns of converted matrices and missing answers
        with suppress(QPError), warnings.catch_warnings(action="ignore"):
            x = qpsolvers.solve_problem(qp, name).x
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
    with refusing(NotCertified):
        data = DoubleProblem(qp).fingerprint
    key = hashlib.sha256(json.dumps([VERSION, work, data]).encode()).hexdigest()
    path = user_cache.folder("proofs") / f"{key}.json"
    found: Certificate | str
    try:
        found = json_file.read(path, CACHED)
        if isinstance(found, Certificate):
            verify(qp, found)
    except (ValueError, NotCertified):  # no file, a damaged one, or that of another program
        try:
            found = certify(qp, begin(qp), work=work)
        except NotCertified as error:
            found = str(error)
        user_cache.keep(path, json.dumps(found if isinstance(found, str) else asdict(found)))
    if isinstance(found, str):
        raise NotCertified(found)
    return found


def isolated(function: Callable[..., T], *arguments: Any) -> T:
    """Call a function of a module that reads or proves programs in a process of its own.

    Raises
    ------
    NotCertified
        The function raised it, or a ValueError with this sentence; or the process died, possibly for a reason outside
        the program.
    """
    result = _in_process(Child(), function, arguments)
    if isinstance(result, NotCertified):
        raise result
    return result


def proven(function: Callable[..., T], calls: Sequence[tuple[Any, ...]]) -> Generator[T | NotCertified]:
    """What :func:`isolated` gives or raises for the arguments of each call, in their order, as many at once as there
    are cores; closing the generator ends the processes.

    Examples
    --------
    >>> list(proven(pow, [(base, 2) for base in range(4)]))
    [0, 1, 4, 9]
    """
    children, threads = [Child() for _ in calls], ThreadPoolExecutor(len(cores.usable()))
    futures = [
        threads.submit(_in_process, child, function, arguments)
        for child, arguments in zip(children, calls, strict=True)
    ]
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


def _in_process(child: Child, function: Callable[..., T], arguments: tuple[Any, ...]) -> T | NotCertified:
    with child:
        try:
            return child.call(HANG_S, _attempt, function, arguments)
        except LostError as error:
            return NotCertified(f"the process that reads and proves it ended with {error}")


def _attempt(function: Callable[..., T], arguments: tuple[Any, ...]) -> T | NotCertified:
    """The result of a function, or the reason why there is no proof."""
    try:
        return function(*arguments)
    except NotCertified as error:
        return error
    except ValueError as error:  # NaN or a wrong shape in the program's data
        return NotCertified(str(error))


def require_size(qp: Problem) -> None:
    """NotCertified if a program is too large for dense matrices."""
    d = qp.q.size
    rows = d + sum(right.size for right in (qp.h, qp.b) if right is not None)
    check(
        rows * d <= LARGEST,
        f"{d} variables with {rows - d} rows are too many for exact arithmetic, which is dense",
        NotCertified,
    )
