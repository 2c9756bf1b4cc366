"""Every solver behind ``qpsolvers.solve_problem``.

    minimise ½ xᵀP x + qᵀx   subject to   G x ≤ h,  A x = b,  lb ≤ x ≤ ub

Source: S. Caron and others, the package qpsolvers, whose residuals and signs of duals this project uses.

Timed: ``setup`` and ``update`` copy, and make P sparse for solvers that take sparse matrices only; ``solve`` is one
call, which converts the problem, sets the solver up and solves. qpsolvers gets our copies of the data, a starting point
only for solvers that use one (others warn), and no bounds of a side if all are infinite, since ECOS and CVXOPT fail
on infinite bounds.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import qpsolvers
from qpsolvers import Problem, Solution
from scipy.sparse import csc_matrix

from solvers.adapter import LibrarySolver, Matrix, Program, Report, Stack, Unsupported, Vector, behind
from solvers.backend import QPSOLVERS as BACKENDS
from solvers.protocol import Lane

WARM_STARTABLE = frozenset({"daqp", "osqp", "proxqp", "scs"})
NEEDS_A_ROW = frozenset({"clarabel", "highs", "qtqp", "scs"})
"""Solvers that get the row 0ᵀx ≤ 1 for a problem without rows: qpsolvers passes one without constraints to SciPy in
their place, and HiGHS ends in "Solve error" (see :mod:`solvers.direct.highspy`)."""
BREAKS_ON_INFINITY = frozenset({"cvxopt", "ecos"})
SPARSE_ONLY = frozenset(qpsolvers.sparse_solvers) - frozenset(qpsolvers.dense_solvers)
INSTALLED = tuple(name for name in BACKENDS if name in qpsolvers.available_solvers)


class QpsolversSolver(LibrarySolver):
    """One solver behind qpsolvers, a subclass made by ``make``."""

    lane = Lane.QPSOLVERS

    def build(self, p: Program, rows: Stack) -> None:  # noqa: D102
        self._is_sparse = self.name in SPARSE_ONLY
        form: Callable[[Matrix], Any] = csc_matrix if self._is_sparse else np.asarray
        if self.name == "qpax":
            import jax  # in single precision by default

            jax.config.update("jax_enable_x64", True)
        sides = [side if np.isfinite(side).any() else None for side in (p.lb, p.ub)]
        if self.name in BREAKS_ON_INFINITY and not all(np.isfinite(side).all() for side in sides if side is not None):
            raise Unsupported(f"{self.name} behind qpsolvers takes the bounds of a side all finite or all infinite")
        G, A = ((form(R), r) if r.size else (None, None) for R, r in ((p.G, p.h), (p.A, p.b)))
        if self.name in NEEDS_A_ROW and p.u.size == p.d:
            G = csc_matrix((1, p.d)), np.ones(1)
        self._problem = Problem(form(p.P), p.q, *G, *A, *sides)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:  # noqa: D102
        if P is not None and self._is_sparse:
            self._problem.P = csc_matrix(P)

    def call_library(self, warm_start: Vector | None) -> Vector | None:  # noqa: D102
        if self.name == "pyqpmad":  # it overwrites P if there is one variable
            self._problem.P = self.program.P.copy()
        try:
            self._answer = qpsolvers.solve_problem(
                self._problem, self.name, warm_start if self.warm_startable else None, **self.settings
            )
        except qpsolvers.ProblemError as error:
            raise Unsupported(f"{self.name} behind qpsolvers refuses the problem: {error}") from error
        except (qpsolvers.SolverError, ArithmeticError) as error:  # the latter of CVXOPT
            self._answer = Solution(self._problem, found=False, extras={"status": str(error)})
        return None if self._answer.x is None else np.asarray(self._answer.x)

    def report(self) -> Report:  # noqa: D102
        a, p, w = self._answer, self.program, np.zeros(self.rows.size)
        for dual, rows in ((a.z_box, p.bounds), (a.y, p.equalities), (a.z, p.inequalities)):
            if dual is not None and np.size(dual) == w[rows].size:
                w[rows] = dual
        count = _first_of(a.extras, "iterations", "iter", "num_iterations")
        status = str(_first_of(a.extras, "status", "infostring") or ("found" if a.found else "not found"))
        iterations = None if count is None else int(np.max(count))
        return Report(bool(a.found), w, status, iterations, a.solve_time and 1e6 * a.solve_time)


def _first_of(extras: Mapping[str, Any], *names: str) -> Any:
    """The first of these entries in the extras of a solution or in their object ``info``, or None."""
    info = extras.get("info", {})
    inside = info if isinstance(info, Mapping) else {name: getattr(info, name, None) for name in names}
    return next((value for name in names for value in (extras.get(name), inside.get(name)) if value is not None), None)


make = behind(QpsolversSolver, BACKENDS, INSTALLED, WARM_STARTABLE)
