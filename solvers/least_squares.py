"""Linear least squares with bounds, without the normal equations.

    minimise f(x) = ½ ‖A x − b‖²   subject to   lb ≤ x ≤ ub

AᵀA has the square of the condition number of A, so beyond 1e7 its rounding decides the answer. Here the exact box
solver on AᵀA only guesses which variables are free; the steps of BVLS correct that. The free variables move to their
least-squares solution, or up to the first bound on the way, and a variable at a bound whose multiplier has the wrong
sign is freed, until there is none. The cost falls with each step. Least squares is solved by QR, with refinement of

    [I    A_F] [r  ]   [b − A_B x_B]
    [A_Fᵀ 0  ] [x_F] = [0          ]

whose residuals are computed in extended precision: each refinement divides the error by about 1/(ε cond A).

With the gradient g and A_F = Q R, the exact minimum over x_F lies ½ ‖R⁻ᵀ g_F‖² below f(x), which x misses by rounding
alone, and the multipliers there are g − Aᵀ Q R⁻ᵀ g_F. If each has its right sign, that is the least cost in the box, by
convexity; the others are freed to bound it. An answer is found if the difference is small.

Sources: P. B. Stark, R. L. Parker, "Bounded-variable least squares: an algorithm and applications", Computational
Statistics 10 (1995), pages 129 to 141; Å. Björck, "Iterative refinement of linear least squares solutions I", BIT 7
(1967), pages 257 to 278.
"""

import numpy as np
from numpy.typing import ArrayLike
from qpsolvers import Problem
from scipy.linalg import qr, solve_triangular

from solvers.arrays import Index, Mask, Matrix, Vector, reals, shaped
from solvers.kernel.box_active_set import BoxActiveSet
from solvers.protocol import box

EPS = float(np.finfo(np.float64).eps)
LONG = np.longdouble
REFINEMENTS = 4
GAP = 1e-9
STEPS = 10
"""Largest number of steps, for each variable."""


class BoxLeastSquares:
    """Least squares with bounds for one matrix and any number of right-hand sides.

    Parameters
    ----------
    A : array, shape (m, d)
        Of any rank and scale.
    b : array, shape (m,)
    lb, ub : array, shape (d,), optional
        Bounds, infinite for none.

    Attributes
    ----------
    found : bool
        Whether the cost of the last answer is within 1e-9 of the least cost, relative, or within the rounding of its
        residuals, (8 ε (‖b‖ + Σ ‖a_k‖ |x_k|))² with the columns a_k and ε = 2⁻⁵²; False before any solve.

    Raises
    ------
    ValueError
        An array has another shape, is not of real numbers or not finite, or bounds cross.

    Examples
    --------
    >>> fit = BoxLeastSquares([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], [1.0, -2.0, 0.5], lb=[0.0, 0.0])
    >>> fit.solve().tolist(), fit.found
    ([0.75, 0.0], True)
    """

    def __init__(self, A: ArrayLike, b: ArrayLike, lb: ArrayLike | None = None, ub: ArrayLike | None = None) -> None:
        matrix = reals("A", A)
        if matrix.ndim != 2 or 0 in matrix.shape or not np.isfinite(matrix).all():
            raise ValueError(f"A must be a matrix of finite numbers, and its shape is {matrix.shape}")
        d = matrix.shape[1]
        sides = (None if side is None else reals(name, side) for name, side in (("lb", lb), ("ub", ub)))
        low, high = box(Problem(np.eye(d), np.zeros(d), None, None, None, None, *sides))
        if not ((low <= high) & (low < np.inf) & (high > -np.inf)).all():
            raise ValueError("a bound is NaN, a lower one above its upper one or at +inf, or an upper one at -inf")
        # Columns of length about one by powers of two, which round nothing.
        self._scale = np.exp2(-np.frexp(np.abs(matrix).max(axis=0))[1])
        self._A = matrix * self._scale
        self._lb, self._ub, self._lengths = low / self._scale, high / self._scale, np.linalg.norm(self._A, axis=0)
        self._b, self.found = self._taken(b), False

    def _taken(self, b: ArrayLike) -> Vector:
        taken = shaped("b", reals("b", b), (len(self._A),)).copy()
        if not np.isfinite(taken).all():
            raise ValueError("b must be finite")
        return taken

    def solve(self, b: ArrayLike | None = None) -> Vector:
        """Return the minimiser (d,), one of them if there are several, for a new b (m,) or the last one; a refused b
        changes nothing."""
        self._b = self._b if b is None else self._taken(b)
        unit = np.exp2(np.frexp(np.abs(self._b).max())[1])  # a power of two; costs of any scale are near one
        right, lb, ub = self._b / unit, self._lb / unit, self._ub / unit
        x, self.found, freed = self._guess(right, lb, ub), False, -1
        free, blocked = (x > lb) & (x < ub), np.zeros(x.size, dtype=bool)
        for _ in range(STEPS * (x.size + 1)):
            factors = self._factors(free)
            z = self._minimum(x, right, *factors)
            outside = np.flatnonzero((z < lb) | (z > ub))
            if outside.size:
                bound = np.where(z < lb, lb, ub)[outside]
                reach = (bound - x[outside]) / (z - x)[outside]
                first = int(np.argmin(reach))
                x, k = np.clip(x + reach[first] * (z - x), lb, ub), outside[first]
                x[k], free[k] = bound[first], False
                blocked[k] |= k == freed and reach[first] <= 0.0  # by rounding: exactly, the cost would fall
                continue
            x = z
            residuals = self._A.astype(LONG) @ x - right
            fall, gradient = self._beyond((self._A.T @ residuals).astype(np.float64), *factors)
            wrong = np.where(x <= lb, -gradient, gradient) * ~free * (lb < ub)
            if (wrong > 0.0).any():
                fall += self._beyond(gradient, *self._factors(free | (wrong > 0.0)))[0]
            rounding = 8 * EPS * float(np.linalg.norm(right) + self._lengths @ np.abs(x))
            self.found = fall <= max(GAP * 0.5 * float(residuals @ residuals), rounding * rounding) < np.inf
            freed = int(np.argmax(np.where(blocked, 0.0, wrong)))
            if self.found or wrong[freed] <= 0.0 or blocked[freed]:
                break
            free[freed] = True
        return np.clip(x * unit, self._lb, self._ub) * self._scale

    def _guess(self, b: Vector, lb: Vector, ub: Vector) -> Vector:
        """The answer of the box solver on AᵀA, or the point of the box next to 0 if it refuses that."""
        solver = BoxActiveSet()
        try:
            solver.setup(Problem(self._A.T @ self._A, -self._A.T @ b, lb=lb, ub=ub))
            return solver.solve().copy()
        except ValueError:
            return np.clip(np.zeros(lb.size), lb, ub)

    def _factors(self, which: Mask) -> tuple[Index, Matrix, Matrix]:
        """Independent columns among these, and their Q and R."""
        columns = np.flatnonzero(which)
        Q, R, order = qr(self._A[:, columns], mode="economic", pivoting=True)
        sizes = np.abs(np.diag(R))
        rank = int(np.count_nonzero(sizes > max(R.shape) * EPS * sizes.max(initial=0.0)))
        return columns[order[:rank]], Q[:, :rank], R[:rank, :rank]

    def _minimum(self, x: Vector, b: Vector, kept: Index, Q: Matrix, R: Matrix) -> Vector:
        """x with these variables at their least-squares solution."""
        A, x, r = self._A.astype(LONG), x.copy(), np.zeros(len(Q))
        for _ in range(REFINEMENTS):
            f = (b - r - A @ x).astype(np.float64)
            h = solve_triangular(R, -(A[:, kept].T @ r).astype(np.float64), trans=1)
            along = Q.T @ f
            x[kept] += solve_triangular(R, along - h)
            r += f + Q @ (h - along)
        return x

    def _beyond(self, gradient: Vector, kept: Index, Q: Matrix, R: Matrix) -> tuple[float, Vector]:
        """How far the cost would fall, and the gradient there, if these variables, with a gradient that is not zero,
        moved on to their least-squares solution, which x rounds."""
        t = solve_triangular(R, gradient[kept], trans=1)
        beyond = gradient - self._A.T @ (Q @ t)
        beyond[kept] = 0.0
        return 0.5 * float(t @ t), beyond
