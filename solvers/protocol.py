"""The interface of a solver.

A quadratic program is

    minimise ½ xᵀP x + qᵀx   subject to   G x ≤ h,  A x = b,  lb ≤ x ≤ ub

as a :class:`qpsolvers.Problem`, and its answer is a :class:`qpsolvers.Solution`: the types of the
ecosystem, with its definitions of the residuals. A solver is one class with four methods (``setup``,
``update``, ``solve``, ``solution``) in a file of its own; the folder of the file is its lane and the
name of the file is its name (see :mod:`solvers.registry`). Its accuracy is chosen by a rung of its ladder,
:meth:`Solver.ladder`.
"""

import copy
import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, ClassVar, NoReturn

import numpy as np
from qpsolvers import Problem as Problem
from qpsolvers import Solution

from solvers.arrays import Matrix as Matrix
from solvers.arrays import Nanoseconds as Nanoseconds
from solvers.arrays import Vector as Vector
from solvers.checks import finite
from solvers.core import UNSOLVED

Timings = tuple[Nanoseconds, Nanoseconds, Matrix]
"""Nanoseconds of updates and of solves, (n,) each, and answers (n, d), NaN if a library found none."""


class Lane(StrEnum):
    """The interface through which a solver is called, whose overhead the user pays too."""

    KERNEL = "kernel"
    """Compiled, no Python call per solve: ours, and libraries by their C functions."""
    DIRECT = "direct"
    """The library's own persistent object."""
    QPSOLVERS = "qpsolvers"
    """``qpsolvers.solve_problem``, which converts the problem and sets the solver up at every call."""
    CVXPY = "cvxpy"
    """A parametrised (DPP) cvxpy problem."""


class Unsupported(Exception):
    """The solver cannot take a feature of the problem; the message is one sentence that names it."""


def setting_text(settings: Mapping[str, Any]) -> str:
    """Canonical text of settings; those of ``ladder(1)`` identify a rung wherever it is stored. JSON has no infinity.

    Examples
    --------
    >>> setting_text({"eps": 1e-6, "adaptive": True, "time_limit": np.inf})
    '{"adaptive": true, "eps": 1e-06, "time_limit": "Infinity"}'
    """
    return json.dumps(json.loads(json.dumps(dict(settings), sort_keys=True, default=str), parse_constant=str))


READY: frozenset[str] = frozenset()
SETUP = frozenset({"setup(problem)"})
AT_WORK = frozenset({"setup(problem), or the end of a call in another thread"})
DATA = frozenset({"P", "q"})
"""What a solver lacks: nothing, a problem, the end of a call, which a library has not reached if it raised, or data."""


class Solver(ABC):
    """One algorithm behind one interface.

    Parameters
    ----------
    **settings
        The library's own settings, such as a rung of the ladder; without any, its defaults.

    Notes
    -----
    ``setup`` and ``update`` are timed separately from ``solve``. ``solve`` returns the array of the answer and builds
    nothing else, so that the solver alone is timed; ``solution`` tells afterwards whether it is found. Input
    arrays are never written to. Data and starts are checked before anything changes, and a call that raises leaves the
    solver as it was, or not ready: then every call raises ValueError, until what is missing has come.
    """

    name: ClassVar[str]
    lane: ClassVar[Lane]
    algorithm: ClassVar[str]
    """Class of the algorithm: "dual active set", "interior point", …"""
    licence: ClassVar[str]
    distribution: ClassVar[str]
    """Installed package whose version is reported: that of the solver's library, or "piezobench"."""
    built_with: ClassVar[str] = ""
    """Compiler and flags of a solver that is compiled on this machine; reported with the version."""
    warm_startable: ClassVar[bool] = False
    """Whether ``solve(warm_start=x)`` uses x."""
    fixed_settings: ClassVar[Mapping[str, Any]] = {}
    """Settings that always apply, unless they are overridden."""
    exponents: ClassVar[tuple[float, ...]] = ()
    """Exponent k of each rung of the ladder, if rungs request cost gaps of about 10⁻ᵏ."""
    _missing: frozenset[str] = SETUP
    """What must come before the next call: a problem, P or q anew, or the end of a call in another thread."""
    _verdict: int = UNSOLVED
    """Whether there is an answer to the present data, and which, as a status of :mod:`solvers.core`. These two are the
    state of readiness, which ``setup``, ``update``, ``solve``, ``solution`` and ``time_kernel`` obey."""

    @classmethod
    def ladder(cls, c: float) -> tuple[Mapping[str, Any], ...]:
        """The settings by which the accuracy is chosen, from loose to tight; the solver of a rung is ``cls(**rung)``.

        A ladder has at most eight rungs of the library's own documented settings and is fixed before the race:
        absolute tolerances are multiples of c, relative ones are 0, and polishing comes last. A method that ends at
        rounding error (active set) has one rung or few. All lanes of a library have the same rungs, except for settings
        that a lane cannot pass on. A library may report failure on the upper rungs, which can request more than
        rounding allows. A solver of ours overrides this method; a library's entry in :mod:`solvers.backend` has its
        tolerances and exponents.

        Parameters
        ----------
        c : float
            The constant of the problem, in the unit of its cost: ½ Σ x², the cost of the zero model. It is known from
            the data alone, before any solve.
        """
        return ({},)

    @classmethod
    def at(cls, setting: str, c: float) -> dict[str, Any]:
        """The settings, for the constant c, of the rung of ``ladder(1)`` with this :func:`setting_text`; {} for the
        defaults.

        Raises
        ------
        ValueError
            The ladder has no such rung.
        """
        texts = [setting_text({**cls.fixed_settings, **rung}) for rung in cls.ladder(1.0)]
        if setting not in (*texts, setting_text(cls.fixed_settings)):
            raise ValueError(f"{cls.name} has no setting {setting!r}; its ladder goes from {texts[0]} to {texts[-1]}")
        return dict(cls.ladder(c)[texts.index(setting)]) if setting in texts else {}

    def __init__(self, **settings: Any) -> None:
        self.settings: dict[str, Any] = {**self.fixed_settings, **settings}

    def __reduce__(self) -> NoReturn:
        """Refuse copies of any kind: they would share the memory of a library, or lose it."""
        raise TypeError(
            f"the solver {self.name} has memory in compiled code and cannot be copied or pickled; set up another one, "
            f"by solvers.get({self.name!r}, **settings) and setup(problem)"
        )

    def _check_ready(self, missing: frozenset[str]) -> None:
        """Raise ValueError if something is missing."""
        if missing:
            needed = "update of " * (missing <= {"P", "q"}) + " and ".join(sorted(missing))
            raise ValueError(f"{self.name} is not ready until the next good {needed}")

    @abstractmethod
    def setup(self, problem: Problem) -> None:
        """Allocate, convert and factorise; raise :class:`Unsupported` for a form the solver cannot take."""

    @abstractmethod
    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Take new data of the same structure; None for data that stay. Later changes of the arrays change no
        answer."""

    @abstractmethod
    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the answer, shape (d,), valid until the next call, found or not; NaN if there is none."""

    def time_kernel(
        self, P: Matrix | None, q: Matrix, warm_start: Vector | None = None, most_ns: float = np.inf
    ) -> Timings:
        """Update and solve inside compiled code for each of P (n, d, d), None for a P that stays, and q (n, d).

        Every solve starts from ``warm_start`` (d,) if it is given. No call begins once ``most_ns`` nanoseconds are
        spent. ``solution`` is that of the last call. Only solvers of the lane kernel have this method.

        Returns
        -------
        updates, solves : array (m,)
            Nanoseconds of each of the m ≤ n calls; a solve includes the copy of its answer.
        answers : array (m, d)
            NaN if a library returned none.
        """
        raise Unsupported(f"{self.name} has no compiled loop to time")

    @abstractmethod
    def solution(self) -> Solution:
        """Return the last answer with duals, ``found`` and, in ``extras``, the library's own status and times."""


def dense(problem: Problem) -> tuple[Matrix, Vector]:
    """P (d, d) and q (d,) of a problem as new C-contiguous float64 arrays; :class:`Unsupported` if d = 0, ValueError
    for another shape or type or a number that is not finite."""
    d = problem.q.size
    if d == 0:
        raise Unsupported("a problem without variables has nothing to solve")
    P = problem.P if isinstance(problem.P, np.ndarray) else problem.P.toarray()
    return finite("P", P, (d, d)).copy(), finite("q", problem.q, (d,)).copy()


def box(problem: Problem) -> tuple[Vector, Vector]:
    """Bounds lb, ub of a problem, shape (d,), infinite for a variable without one; ValueError for another shape or
    type, NaN, and a bound that nothing meets."""
    d = problem.q.size
    sides = (("lb", problem.lb, -np.inf), ("ub", problem.ub, np.inf))
    lb, ub = (np.full(d, none) if side is None else finite(name, side, (d,), none).copy() for name, side, none in sides)
    return lb, ub


def only_box(problem: Problem, name: str) -> tuple[Vector, Vector]:
    """The bounds of a problem without general rows; :class:`Unsupported` if it has some."""
    if any(array is not None for array in (problem.G, problem.h, problem.A, problem.b)):
        raise Unsupported(f"{name} takes bounds only, and the problem has general rows")
    return box(problem)


def box_duals(gradient: Vector, lb: Vector, ub: Vector, x: Vector) -> Vector:
    """z_box (d,) = −g where x is at a bound and −g has its sign (negative at a lower bound, positive at an upper one),
    zero elsewhere."""
    lower, upper = np.where(x <= lb, -gradient, 0.0), np.where(x >= ub, -gradient, 0.0)
    return np.where((x <= lb) & (x >= ub), lower, np.minimum(lower, 0.0) + np.maximum(upper, 0.0))


def box_solution(problem: Problem, x: Vector, found: bool, **extras: Any) -> Solution:
    """The solution of a problem with bounds only by a solver that computes no duals.

    The duals follow from the gradient g = P x + q, see :func:`box_duals`.
    """
    nothing, problem = np.zeros(0), copy.deepcopy(problem)  # whose arrays may be the solver's own
    return Solution(
        problem,
        found=found,
        x=x.copy(),
        y=nothing,
        z=nothing,
        z_box=box_duals(problem.P @ x + problem.q, *box(problem), x),
        obj=float(0.5 * x @ (problem.P @ x) + problem.q @ x),
        extras=extras,
    )
