"""Every solver behind ``qpsolvers.solve_problem``.

    minimise ½ xᵀP x + qᵀx   subject to   G x ≤ h,  A x = b,  lb ≤ x ≤ ub

Source: S. Caron and others, the package qpsolvers, whose residuals and signs of duals this project uses.

Timed: ``setup`` and ``update`` copy, and make P sparse for a solver that takes nothing else; ``solve`` is one call,
which converts, sets up and solves from the start every time. Its habits are kept away from the caller: it sees our
copies, a starting point goes only to solvers that use one (others warn), and a side whose bounds are all infinite is
left out, since ECOS and CVXOPT break on infinite bounds.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import qpsolvers
from qpsolvers import Problem, Solution
from scipy.sparse import csc_matrix

from solvers import backend as known
from solvers.backend import Backend, LibrarySolver
from solvers.protocol import Lane, Matrix, Solver, Unsupported, Vector, box, dense

BACKENDS: dict[str, Backend] = {
    "clarabel": known.CLARABEL,
    "copt": known.COPT,
    "cvxopt": known.CVXOPT,
    "daqp": replace(known.DAQP, warm=True),
    "ecos": known.ECOS,
    "gurobi": known.GUROBI,
    "highs": known.HIGHS,
    # osqp warns where nobody says whether a failure raises.
    "osqp": replace(known.OSQP, always={**known.OSQP.always, "raise_error": False}, warm=True),
    "piqp": known.PIQP,
    "proxqp": replace(known.PROXQP, warm=True),
    "pyqpmad": known.PYQPMAD,  # qpsolvers loses its duals of variables fixed by lb = ub
    "qpalm": known.QPALM,  # qpsolvers drops the starting point
    "qpax": known.QPAX,
    "qtqp": known.QTQP,
    "quadprog": known.QUADPROG,
    "scs": replace(known.SCS, warm=True),
}
HANDED_TO_SCIPY = frozenset({"clarabel", "qtqp", "scs"})
"""For these qpsolvers solves a problem without constraints by SciPy instead."""
FAILS_WITHOUT_ROWS = frozenset({"highs"})
"""These get a row 0ᵀx ≤ ∞ where a problem has none (see :mod:`solvers.direct.highspy`)."""
BREAKS_ON_INFINITY = frozenset({"cvxopt", "ecos"})
SPARSE_ONLY = frozenset(qpsolvers.sparse_solvers) - frozenset(qpsolvers.dense_solvers)


class QpsolversSolver(LibrarySolver):
    """One solver behind qpsolvers; :func:`make` says which."""

    lane = Lane.QPSOLVERS
    sparse: ClassVar[bool]

    def _own(self, matrix: Any) -> Any:
        array = np.array(matrix if isinstance(matrix, np.ndarray) else matrix.toarray(), dtype=np.float64, order="C")
        return csc_matrix(array) if self.sparse else array

    def setup(self, problem: Problem) -> None:  # noqa: D102
        if problem.is_unconstrained and self.name in HANDED_TO_SCIPY:
            raise Unsupported(f"qpsolvers solves a problem without constraints by SciPy in place of {self.name}")
        if self.name == "qpax":
            import jax  # single precision otherwise

            jax.config.update("jax_enable_x64", True)
        sides = [side if np.isfinite(side).any() else None for side in box(problem)]
        if self.name in BREAKS_ON_INFINITY and not all(np.isfinite(side).all() for side in sides if side is not None):
            raise Unsupported(f"{self.name} behind qpsolvers takes the bounds of a side all finite or all infinite")
        rows = [
            None if part is None else self._own(part) if np.ndim(part) != 1 else np.array(part, dtype=np.float64)
            for part in (problem.G, problem.h, problem.A, problem.b)
        ]
        P, q = dense(problem)
        self._problem = self._asked = Problem(self._own(P), q, *rows, *sides)
        if self.name in FAILS_WITHOUT_ROWS and problem.G is None and problem.A is None:
            self._asked = Problem(self._problem.P, q, csc_matrix((1, q.size)), np.array([np.inf]), None, None, *sides)

    def update(self, P: Matrix | None = None, q: Vector | None = None) -> None:  # noqa: D102
        if P is not None:
            self._problem.P = self._asked.P = self._own(P)
        if q is not None:
            self._problem.q = self._asked.q = np.array(q, dtype=np.float64)

    def solve(self, warm_start: Vector | None = None) -> Vector:  # noqa: D102
        start = warm_start if self.warm_startable else None
        try:
            self._answer = qpsolvers.solve_problem(self._asked, self.name, initvals=start, **self.settings)
        except qpsolvers.ProblemError as error:
            raise Unsupported(f"{self.name} behind qpsolvers refuses the problem: {error}") from error
        except qpsolvers.SolverError as error:
            self._answer = Solution(self._problem, found=False, extras={"status": str(error)})
        x = self._answer.x
        return np.asarray(x) if self._answer.found else np.full(self._problem.q.size, np.nan)

    def solution(self) -> Solution:  # noqa: D102
        a = self._answer
        count = _said(a.extras, "iterations", "iter", "num_iterations")
        extras = {
            "status": str(_said(a.extras, "status", "infostring") or ("found" if a.found else "not found")),
            "iterations": None if count is None else int(np.max(count)),
            "reported_us": None if a.solve_time is None else 1e6 * a.solve_time,
        }
        problem = Problem(*self._problem.unpack())
        if not a.found:
            return Solution(problem, found=False, extras=extras)
        x, y, z, z_box = (
            np.zeros(0) if part is None else np.array(part, dtype=np.float64)
            for part in (a.x, a.y, a.z if self._problem.G is not None else None, a.z_box)
        )
        if z_box.size == 0:
            z_box = np.zeros(x.size)
        cost = float(0.5 * x @ (problem.P @ x) + problem.q @ x)
        return Solution(problem, found=True, obj=cost, x=x, y=y, z=z, z_box=z_box, extras=extras)


def _said(extras: Mapping[str, Any], *names: str) -> Any:
    """The first of the names that the extras of a solution know, or the object ``info`` inside; None where none is."""
    info = extras.get("info", {})
    inside = info if isinstance(info, Mapping) else {name: getattr(info, name, None) for name in names}
    return next((value for name in names for value in (extras.get(name), inside.get(name)) if value is not None), None)


def names() -> tuple[str, ...]:
    """The solvers of the table, installed here or not."""
    return tuple(BACKENDS)


def installed() -> tuple[str, ...]:
    """The solvers of the table that are installed here."""
    return tuple(name for name in BACKENDS if name in qpsolvers.available_solvers)


def make(name: str) -> type[Solver]:
    """The class of one solver behind qpsolvers.

    Raises
    ------
    ImportError
        The solver is not installed, or not in the table.

    Examples
    --------
    >>> make("piqp").algorithm
    'proximal interior point'
    """
    if name not in installed():
        raise ImportError(f"{name!r} is not installed, or qpsolvers does not find it")
    b = BACKENDS[name]
    return type(
        f"Qpsolvers_{name}",
        (QpsolversSolver,),
        {
            "__doc__": f"{name} behind qpsolvers.",
            "name": name,
            "library": b,
            "warm_startable": b.warm,
            "sparse": name in SPARSE_ONLY,
        },
    )
