"""A quadratic program as dense arrays, its constraints as rows, and triangles of P.

Every form of the constraints that a library takes is a selection of the rows of one stack,

    l ≤ R x ≤ u,   R = [I; A; G],   l = [lb; b; −∞],   u = [ub; b; h],

whose multipliers w are those of :class:`qpsolvers.Solution` stacked, w = [z_box; y; z]:

    P x + q + Rᵀw = 0,   w_i > 0 only where row i is at u_i,   w_i < 0 only where it is at l_i.

Sources: S. Boyd and L. Vandenberghe, Convex Optimization (2004), section 5.5.3 for the conditions; the signs are
those of the qpsolvers documentation of ``Solution``.
"""

from copy import deepcopy
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from qpsolvers import Problem, Solution
from scipy.sparse import csc_matrix

from solvers.arrays import Mask, shaped
from solvers.checks import check_status, finite
from solvers.core import CROSSED, bindings
from solvers.protocol import Matrix, Vector, box, dense

Index = NDArray[np.int32]


class Arrays:
    """The arrays of a problem, dense, checked and copied: P (d, d), q, lb, ub (d,), G (m, d), h (m,), A (p, d), b (p,).

    Raises
    ------
    Unsupported
        The problem has no variables.
    ValueError
        NaN, a meaningless infinity, a wrong shape or another type.
    """

    def __init__(self, problem: Problem) -> None:
        self.P, self.q = dense(problem)
        self.lb, self.ub = box(problem)
        self.A, self.b = dense_rows(problem, "A", "b")
        self.G, self.h = dense_rows(problem, "G", "h", np.inf)


class Program(Arrays):
    """The arrays of a problem, checked, contiguous and copies, so that a library may keep pointers to them.

    Parameters
    ----------
    problem : qpsolvers.Problem
        P, G and A dense or scipy sparse, of any strides and order; it is not written to.

    Attributes
    ----------
    P, q : ndarray
        Cost, shapes (d, d) in C order and (d,). P is symmetric, so ``P.T`` is P in Fortran order.
    R, l, u : ndarray
        The stacked rows, shapes (d + p + m, d) in C order and (d + p + m,): d bounds, p equalities, m inequalities.
    lb, ub, A, b, G, h : ndarray
        The parts of the stack: bounds (d,), equalities, inequalities.
    bounds, equalities, inequalities, general : slice
        Positions of each kind in the stack, and those of equalities and inequalities together.

    Raises
    ------
    Unsupported
        The problem has no variables.
    ValueError
        An array fails a check of :mod:`solvers.checks`.
    """

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.d = d = self.q.size
        check_status(CROSSED if np.any(self.lb > self.ub) else bindings.check_all(self.P[None], self.q[None]))
        self._finite: Mask = self.h < np.inf  # the other rows of G are no constraints
        self.G, h = self.G[self._finite], self.h[self._finite]
        self.l: Vector = np.concatenate([self.lb, self.b, np.full(h.size, -np.inf)])
        self.u: Vector = np.concatenate([self.ub, self.b, h])
        ends = [d, d + self.b.size]
        self.bounds, self.equalities, self.inequalities = slice(0, d), slice(*ends), slice(ends[1], None)
        self.general = slice(d, None)
        self.lb, self.ub, self.b, self.h = self.l[:d], *np.split(self.u, ends)
        self._problem = problem

    @cached_property
    def R(self) -> Matrix:
        """The rows of all constraints."""
        return np.vstack([np.eye(self.d), self.A, self.G])

    @cached_property
    def triangle(self) -> "Triangle":
        """The sparsity pattern of the upper triangle of P."""
        return Triangle(self.d)

    def set_data(self, P: Matrix | None, q: Vector | None) -> None:
        """Copy new P (d, d) and q (d,), None for data that stay, into this program's arrays, which stay in place.

        Raises
        ------
        ValueError
            An array has another shape, is not of finite real numbers or, of P, not symmetric; then nothing is taken.
        """
        try:
            status = bindings.copy_data(self.P, self.q, P, q)
        except (TypeError, ValueError, BufferError):  # arrays of other types and layouts are converted
            return self.set_data(*self.shaped(P, q))
        if status:
            check_status(status, P=P, q=q)

    def shaped(self, P: ArrayLike | None, q: ArrayLike | None) -> tuple[Matrix | None, Vector | None]:
        """P (d, d) and q (d,) as contiguous doubles, None for data that stay; ValueError for another shape or type."""
        arrays = (("P", P, self.P), ("q", q, self.q))
        P, q = (None if new is None else shaped(name, new, old.shape) for name, new, old in arrays)
        return P, q

    def several(
        self, P: ArrayLike | None, q: ArrayLike, start: ArrayLike | None
    ) -> tuple[Matrix | None, Matrix, Vector | None]:
        """P (n, d, d) or None, q (n, d) and a start (d,) as contiguous doubles, checked."""
        count, d = len(np.atleast_1d(q)), self.d
        P, q = None if P is None else shaped("P", P, (count, d, d)), shaped("q", q, (count, d))
        check_status(bindings.check_all(P, q), P=P, q=q)
        return P, q, self.start(start)

    def start(self, warm_start: Any) -> Vector | None:
        """A starting point (d,) as contiguous doubles, or None; ValueError for another shape or type, and for a number
        that is not finite."""
        try:
            is_good = warm_start is None or (
                type(warm_start) is np.ndarray and warm_start.shape == self.q.shape and bindings.all_finite(warm_start)
            )
        except (TypeError, ValueError, BufferError):  # an array of another type or layout
            is_good = False
        return warm_start if is_good else finite("warm_start", warm_start, self.q.shape)

    def solution(
        self, extras: dict[str, Any], x: Vector | None = None, w: Vector | None = None, found: bool = False
    ) -> Solution:
        """The solution with a copy of the answer x (d,) and the multipliers w of all rows of the stack; None for no
        answer."""
        problem = deepcopy(self._problem)
        problem.P, problem.q = self.P.copy(), self.q.copy()
        if x is None or w is None:
            return Solution(problem, found=False, extras=extras)
        z = np.zeros(self._finite.size)
        z[self._finite] = w[self.inequalities]
        return Solution(
            problem,
            found=found,
            x=x.copy(),
            y=w[self.equalities].copy(),
            z=z,
            z_box=w[self.bounds].copy(),
            obj=float(x @ (0.5 * (self.P @ x) + self.q)),
            extras=extras,
        )


class Stack:
    """The whole stack of rows, or a selection of them."""

    _selection: Any = slice(None)
    _signs: Any = 1.0

    def __init__(self, program: Program) -> None:
        self.size = program.u.size

    def scatter(self, w: Vector) -> Vector:
        """The multipliers of the stack from those of these rows, shape (k,), with w ≥ 0 for inequalities s ≥ 0."""
        whole = np.zeros(self.size)
        np.add.at(whole, self._selection, self._signs * w)  # both sides of a row may be among them
        return whole


class Intervals(Stack):
    """The rows with a finite side, as intervals l ≤ R x ≤ u, R (k, d)."""

    def __init__(self, program: Program) -> None:
        super().__init__(program)
        self._selection = np.isfinite(program.l) | np.isfinite(program.u)
        self.R, self.l, self.u = program.R[self._selection], program.l[self._selection], program.u[self._selection]


class Cones(Stack):
    """The rows as R x + s = r with finite r: s = 0 for equalities and fixed variables, s ≥ 0 for inequalities.

    R (k, d) and r (k,) have ``equal`` equalities, followed by ``unequal`` inequalities.
    """

    def __init__(self, program: Program) -> None:
        super().__init__(program)
        # With a fixed variable as two inequalities, the feasible set would have no interior.
        equal = program.l == program.u
        kinds = equal, np.isfinite(program.u) & ~equal, np.isfinite(program.l) & ~equal
        self._selection = np.concatenate([np.flatnonzero(kind) for kind in kinds])
        self._signs = np.repeat([1.0, 1.0, -1.0], [kind.sum() for kind in kinds])
        self.R = self._signs[:, None] * program.R[self._selection]
        self.r = self._signs * np.where(self._signs > 0.0, program.u[self._selection], program.l[self._selection])
        self.equal = int(equal.sum())
        self.unequal = self.r.size - self.equal


class Triangle:
    """One triangle of a symmetric matrix in compressed columns, zeros stored too.

    ``csc_matrix(P)`` drops exact zeros, so values that are updated later would not match its pattern. Here the pattern
    does not depend on the values, and new values are one indexed copy.

    Parameters
    ----------
    d : int
        Order of the matrix.
    upper : bool
        Whether it is the upper triangle.

    Examples
    --------
    >>> t = Triangle(2)
    >>> t.matrix(np.array([[1.0, 0.0], [0.0, 3.0]])).data.tolist()
    [1.0, 0.0, 3.0]
    """

    def __init__(self, d: int, upper: bool = True) -> None:
        # Row by row through one triangle is column by column through the other, and P is symmetric.
        row, column = np.tril_indices(d) if upper else np.triu_indices(d)
        self.indices: Index = column.astype(np.int32)
        self.indptr: Index = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=d))]).astype(np.int32)
        self._flat = row * d + column
        self.shape = (d, d)

    def values(self, P: Matrix) -> Vector:
        """The stored values of a symmetric matrix P (d, d), column by column, as a new array."""
        return P.take(self._flat)

    def matrix(self, P: Matrix) -> csc_matrix:
        """This triangle of P as a sparse matrix with arrays of its own, since osqp overwrites its input."""
        return csc_matrix((self.values(P), self.indices.copy(), self.indptr.copy()), shape=self.shape)


def dense_rows(problem: Problem, left: str, right: str, absent: float | None = None) -> tuple[Matrix, Vector]:
    """Rows and right-hand side of one kind as dense arrays, of 0 rows if the problem has none of that kind; ValueError
    for numbers that are not finite, except for the value of an absent row, and for shapes that do not fit."""
    matrix, sides, d = getattr(problem, left), getattr(problem, right), problem.q.size
    if (matrix is None) != (sides is None):
        raise ValueError(f"the problem has only one of {left} and {right}")
    if matrix is None:
        return np.zeros((0, d)), np.zeros(0)
    rows, r = np.atleast_2d(matrix if isinstance(matrix, np.ndarray) else matrix.toarray()), np.ravel(sides)
    return finite(left, rows, (r.size, d)).copy(), finite(right, r, r.shape, absent).copy()
