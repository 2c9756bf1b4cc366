"""What a solver is, in the vocabulary of the race.

A quadratic program is

    minimise ½ xᵀP x + qᵀx   subject to   G x ≤ h,  A x = b,  lb ≤ x ≤ ub

as a :class:`qpsolvers.Problem`, and its answer is a :class:`qpsolvers.Solution`: the types of the
ecosystem, with its definitions of the residuals. A solver is one class with four methods (``setup``,
``update``, ``solve``, ``solution``) in a file of its own; the folder of the file is its lane and the
name of the file is its name (see :mod:`solvers.registry`). How exact an answer it is asked for is a rung of its
ladder, :meth:`Solver.ladder`.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np
from qpsolvers import Problem, Solution

from solvers.arrays import Matrix as Matrix
from solvers.arrays import Nanoseconds as Nanoseconds
from solvers.arrays import Vector as Vector
from solvers.timed_calls import Timings as Timings


class Lane(StrEnum):
    """Through what a solve is called, which is part of what the user pays."""

    KERNEL = "kernel"
    """Compiled, no Python call per solve: ours, and libraries by their C functions."""
    DIRECT = "direct"
    """The library's own persistent object."""
    QPSOLVERS = "qpsolvers"
    """``qpsolvers.solve_problem``: converts and sets up again at every call."""
    CVXPY = "cvxpy"
    """A parametrised (DPP) cvxpy problem."""
    CODEGEN = "codegen"
    """C that a library writes for an embedded system, all built alike, no Python call per solve; raced when asked
    for."""


class Tier(StrEnum):
    """What an answer must reach, the same for all."""

    DEFAULT = "default"
    """The library's own settings."""
    LOW = "low"
    """Relative cost gap 1e-3."""
    MID = "mid"
    """Relative cost gap 1e-6."""
    HIGH = "high"
    """Relative cost gap 1e-9."""
    EXACT = "exact"
    """Relative cost gap 1e-12."""
    STAGE = "stage"
    """The stage does not notice: the model errs on unseen data as that of the exact optimum, within 1 % of the sensor's
    noise."""


class Status(StrEnum):
    """How a task ended. A broken adapter is never reported as a failing solver."""

    OK = "ok"
    """The answer is as exact as the judge asks."""
    MISSED = "missed"
    """The solver says solved, and the answer is not what was asked for."""
    SOLVER_FAILED = "solver_failed"
    """The solver itself says that it found no answer."""
    ADAPTER_FAILED = "adapter_failed"
    """Our code, or the library's interface, raised."""
    UNSUPPORTED = "unsupported"
    """The solver cannot take a problem of this form."""
    CRASHED = "crashed"
    """The process died."""
    TIMED_OUT = "timed_out"
    """The process was stopped at its time limit."""
    OUT_OF_MEMORY = "out_of_memory"
    """The process was stopped at its memory limit."""
    LAZY = "lazy"
    """What it returns is not an array, but becomes one later."""
    STALE = "stale"
    """A timed answer is that of other data."""
    ERRATIC = "erratic"
    """The first answer is right and most of those that were timed are not."""
    CACHED = "cached"
    """Data that it has seen before are answered far faster."""
    MISTIMED = "mistimed"
    """Its times cannot be: none at all, or not what its process took by the parent's clocks."""
    PEEKED = "peeked"
    """Its process looked into the files of the race."""
    TAMPERED = "tampered"
    """Its process replaced what times it or carries its answers."""
    NOT_RUN = "not_run"
    """A looser setting of the same solver crashed, was stopped or took too long on this problem."""
    LATE = "late"
    """Right, and after its deadline."""


class Unsupported(Exception):
    """The problem has a feature that this solver cannot take; the message is one sentence that says which."""


def setting_text(settings: Mapping[str, Any]) -> str:
    """The name of a setting: what ``ladder(1)`` says of it, the same wherever it is stored.

    Examples
    --------
    >>> setting_text({"eps": 1e-6, "adaptive": True})
    '{"adaptive": true, "eps": 1e-06}'
    """
    return json.dumps(dict(settings), sort_keys=True, default=str)


class Entrant(ABC):
    """Whatever takes part in a race, as far as it is described."""

    algorithm: ClassVar[str]
    """Class of the algorithm in the field's words: "dual active set", "interior point", …"""
    licence: ClassVar[str]
    distribution: ClassVar[str]
    """Name of the installed package whose version is reported; that of the solver's library, or "piezobench"."""
    built_with: ClassVar[str] = ""
    """Compiler and flags of what is built on this machine; reported with the version."""
    warm_startable: ClassVar[bool] = False
    """Whether ``solve(warm_start=x)`` makes use of x."""
    always: ClassVar[Mapping[str, Any]] = {}
    """Settings of every use, which others on top may change."""
    exponents: ClassVar[tuple[float, ...]] = ()
    """Of the rungs of the ladder, where each asks for a cost gap of about 10⁻ᵏ: k."""

    @classmethod
    def ladder(cls, c: float) -> tuple[Mapping[str, Any], ...]:
        """The settings that are tried to reach an accuracy, from loose to tight; a rung is ``cls(**rung)``.

        A ladder has at most eight rungs, of the library's own documented settings, and is fixed before anything is
        raced: absolute tolerances are multiples of c, relative ones are 0, and what polishes an answer comes last. What
        ends at rounding (an active set) has one rung or few. Rungs are the same in every lane of a library, but for
        what a lane cannot hand on. Nothing promises that an upper rung is reached: asked for more than rounding allows,
        a library says that it failed. To declare one, a solver of ours overrides this method, and a library's entry in
        :mod:`solvers.backend` names the tolerances and exponents.

        Parameters
        ----------
        c : float
            The constant of the problem, in the unit of its cost: ½ Σ x², what the model that is zero costs. It is known
            from the data alone, before any solve.
        """
        return ({},)

    @classmethod
    def at(cls, setting: str, c: float) -> dict[str, Any]:
        """The settings for the constant c of what :func:`setting_text` calls a rung of ``ladder(1)``, or the use
        without any.

        Raises
        ------
        ValueError
            The ladder has no such rung.
        """
        for rung, here in zip(cls.ladder(1.0), cls.ladder(c), strict=True):
            if setting_text({**cls.always, **rung}) == setting:
                return dict(here)
        if setting != setting_text(cls.always):
            raise ValueError(f"{cls.__name__} has no setting {setting} in its ladder")
        return {}


class Solver(Entrant):
    """One algorithm behind one interface.

    Parameters
    ----------
    **settings
        The library's own settings, such as a rung of the ladder; without any, its defaults.

    Notes
    -----
    ``setup`` and ``update`` are timed apart from ``solve``. ``solve`` returns the array of the answer and builds
    nothing else, so that the clock sees the solver alone; whether the answer is one is asked of ``solution``
    afterwards. Arrays handed in are never written to.
    """

    name: ClassVar[str]
    lane: ClassVar[Lane]
    takes_rows: ClassVar[bool] = False
    """Whether the solver follows data that come row by row by ``append``; it then has the setting ``forgetting``."""
    iteration_setting: ClassVar[str | None] = None
    """Name of the setting that limits the iterations of one solve, where the iterate at the limit can be had."""

    def __init__(self, **settings: Any) -> None:
        self.settings: dict[str, Any] = {**self.always, **settings}

    @abstractmethod
    def setup(self, problem: Problem) -> None:
        """Allocate, convert and factorise; raise :class:`Unsupported` for a form the solver cannot take."""

    @abstractmethod
    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:
        """Take new data of the same structure; what is None stays."""

    @abstractmethod
    def solve(self, warm_start: Vector | None = None) -> Vector:
        """Return the answer, shape (d,), valid until the next call."""

    def append(self, row: Vector, target: float) -> None:
        """Take the row ξ (d,) and the number x of one squared error ½ (vᵀξ + x)² more, in place of ``update``."""
        raise Unsupported(f"{self.name} takes no rows")

    def iterate(self) -> Vector | None:
        """Return where the last solve stood when its iteration limit ended it, shape (d,); None after any other end.

        A library that then calls the answer almost solved is taken at its word that there is one.
        """
        return None

    def time_rows(self, rows: Matrix, forgetting: float) -> tuple[Matrix, Nanoseconds]:
        """Take rows (ξ, x), shape (N, d + 1), one after the other inside compiled code and answer after each.

        Returns
        -------
        answers : array (N, d)
        nanoseconds : array (N,)
            What the solver's part of each row took: everything but :func:`solvers.forgetting.absorb`, unless
            that is the solver's own work.
        """
        raise Unsupported(f"{self.name} has no compiled loop over rows")

    def time_kernel(self, P: Matrix, q: Matrix, warm_start: Vector | None = None, most_ns: float = np.inf) -> Timings:
        """Update and solve inside compiled code for each of P (n, d, d) and q (n, d), which it has not seen before.

        Every solve starts from ``warm_start`` (d,) where one is given. After the call at which ``most_ns`` are spent no
        other begins. ``solution`` is that of the last. Only solvers of the lanes kernel and codegen have it.

        Returns
        -------
        updates, solves : array (m,)
            Nanoseconds of each of the m ≤ n calls; the answer is copied within those of its solve.
        answers : array (m, d)
            NaN where a library found none.
        """
        raise Unsupported(f"{self.name} has no compiled loop to time")

    @abstractmethod
    def solution(self) -> Solution:
        """Return the last answer with duals, ``found`` and, in ``extras``, the library's own status and times."""


def dense(problem: Problem) -> tuple[Matrix, Vector]:
    """P (d, d) and q (d,) of a problem as fresh C-contiguous float64 arrays; :class:`Unsupported` where d is 0."""
    if problem.q.size == 0:
        raise Unsupported("a problem without variables has nothing to solve")
    P = problem.P if isinstance(problem.P, np.ndarray) else problem.P.toarray()
    return np.array(P, dtype=np.float64, order="C"), np.array(problem.q, dtype=np.float64)


def box(problem: Problem) -> tuple[Vector, Vector]:
    """Bounds lb, ub of a problem, shape (d,), infinite where there is none."""
    d = problem.q.shape[0]
    lb = np.full(d, -np.inf) if problem.lb is None else np.array(problem.lb, dtype=np.float64)
    ub = np.full(d, np.inf) if problem.ub is None else np.array(problem.ub, dtype=np.float64)
    return lb, ub


def only_box(problem: Problem, name: str) -> tuple[Vector, Vector]:
    """The bounds of a problem that has nothing but bounds, or :class:`Unsupported`."""
    if problem.G is not None or problem.A is not None:
        raise Unsupported(f"{name} takes bounds only, and the problem has general rows")
    return box(problem)


def box_duals(gradient: Vector, lb: Vector, ub: Vector, x: Vector) -> Vector:
    """z_box (d,) = −g where x touches a bound and the sign is right (negative at the lower bound, positive at the
    upper), zero elsewhere."""
    lower, upper = np.where(x <= lb, -gradient, 0.0), np.where(x >= ub, -gradient, 0.0)
    return np.where((x <= lb) & (x >= ub), lower, np.minimum(lower, 0.0) + np.maximum(upper, 0.0))


def box_solution(problem: Problem, x: Vector, found: bool, **extras: Any) -> Solution:
    """Wrap the answer of a solver that has no duals of its own on a problem with bounds only.

    The duals are those that the gradient g = P x + q implies, see :func:`box_duals`.
    """
    nothing = np.zeros(0)
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
