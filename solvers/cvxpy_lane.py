"""Every solver of quadratic programs behind cvxpy, with one parametrised problem that is compiled once.

    minimise ½ ‖S x‖² + qᵀx   subject to   A x = b,  G x ≤ h,  lb ≤ x ≤ ub,   with parameters S and q,   SᵀS = P

Source: A. Agrawal, B. Amos, S. Barratt, S. Boyd, S. Diamond, J. Z. Kolter, "Differentiable convex optimization layers",
Advances in Neural Information Processing Systems 32 (2019), for the rules of problems with parameters.

``quad_form(x, P)`` with a parameter P violates the rules of disciplined parametrised programming (DPP) and would be
compiled at every solve; ``sum_squares(S @ x)`` does not. The price: cvxpy writes the square as ‖t‖² with d more
variables t and d more equations t = S x, so a solver gets a problem of twice the size, a cost that is singular in x,
and a feasibility tolerance ε on t = S x, which allows an error of up to ε √‖P⁻¹‖ in x; ECOS and CVXOPT get a
second-order cone. Compared with the lane qpsolvers at the tier HIGH, on ten problems of 18 variables with cond P = 1e6,
the largest error of x rose from 1e-13 to 3e-12 for DAQP and from 4e-8 to 3e-7 for SCS, did not change for Clarabel,
HiGHS and ProxQP, and CVXOPT solved none instead of all.

Timed: ``setup`` compiles; ``update`` factorises P and sets the parameters; ``solve`` inserts them, calls the solver and
unpacks the answer. The default tier has cvxpy's own defaults, which differ from the libraries' (OSQP: 1e-5). cvxpy
takes no starting point: its ``warm_start`` reuses the solver's object and last answer. So no class here is
``warm_startable``; a starting point turns this reuse on, and without one the solver is set up anew for every solve.
"""

import logging
from typing import Any

import numpy as np
import scipy.linalg

from solvers.adapter import LibrarySolver, Matrix, Program, Report, Stack, Unsupported, Vector, behind
from solvers.backend import CVXPY as BACKENDS
from solvers.protocol import Lane

# The registry reports libraries that do not load; CVXPY would do so on standard error in every process.
logging.getLogger("__cvxpy__").addFilter(lambda record: "importing solver" not in record.getMessage())
import cvxpy as cp  # noqa: E402

INSTALLED = tuple(name for name in BACKENDS if name.upper() in cp.installed_solvers())


def square_root(P: Matrix) -> Matrix:
    """S with SᵀS = P, (d, d): the upper Cholesky factor, or from eigenvalues if P is singular.

    Raises
    ------
    Unsupported
        P has an eigenvalue below −1e-12 ‖P‖.

    Examples
    --------
    >>> square_root(np.array([[4.0, 2.0], [2.0, 1.0]])).shape
    (2, 2)
    """
    try:
        return scipy.linalg.cholesky(P)
    except scipy.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(P)
        if values[0] < -1e-12 * values[-1]:
            raise Unsupported(f"cvxpy needs a positive semidefinite P; one eigenvalue is {values[0]:.3g}") from None
        return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T


class CvxpySolver(LibrarySolver):
    """One solver behind cvxpy, a subclass made by ``make``."""

    lane = Lane.CVXPY

    def build(self, p: Program, rows: Stack) -> None:  # noqa: D102
        self._x, self._S, self._q = cp.Variable(p.d), cp.Parameter((p.d, p.d)), cp.Parameter(p.d)
        self._S.value, self._q.value = square_root(p.P), p.q.copy()
        numbers = np.arange(rows.size)
        above, below = np.flatnonzero(np.isfinite(p.ub)), np.flatnonzero(np.isfinite(p.lb))
        # Each block of constraints with its row numbers in the stack and the sign of its multipliers there.
        blocks: tuple[tuple[Any, float, Any], ...] = (
            (numbers[p.equalities], 1.0, p.A @ self._x == p.b if p.b.size else None),
            (numbers[p.inequalities], 1.0, p.G @ self._x <= p.h if p.h.size else None),
            (above, 1.0, self._x[above] <= p.ub[above] if above.size else None),
            (below, -1.0, self._x[below] >= p.lb[below] if below.size else None),
        )
        self._blocks = [block for block in blocks if block[2] is not None]
        cost = 0.5 * cp.sum_squares(self._S @ self._x) + self._q @ self._x
        self.model = cp.Problem(cp.Minimize(cost), [constraint for _, _, constraint in self._blocks])
        self.model.get_problem_data(self.name.upper())

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:  # noqa: D102
        if P is not None:
            self._S.value = square_root(P)
        if q is not None:
            self._q.value = q.copy()

    def call_library(self, warm_start: Vector | None) -> Vector | None:  # noqa: D102
        try:
            self.model.solve(solver=self.name.upper(), warm_start=warm_start is not None, **self.settings)
            self._status = str(self.model.status)
        except cp.SolverError as error:  # and x keeps the answer of an earlier call
            self._status, self._x.value = str(error), None
        return self._x.value

    def report(self) -> Report:  # noqa: D102
        w = np.zeros(self.rows.size)
        if self._x.value is None:
            return Report(False, w, self._status)
        for numbers, sign, constraint in self._blocks:
            w[numbers] += sign * np.array(constraint.dual_value, dtype=np.float64)  # NaN for none
        stats, is_found = self.model.solver_stats, self._status == cp.OPTIMAL
        return Report(is_found, w, self._status, stats.num_iters, 1e6 * stats.solve_time if stats.solve_time else None)


make = behind(CvxpySolver, BACKENDS, INSTALLED)
