"""Gaps of many answers in floating point, with bounds on their errors, for programs with bounds only and a definite P.

    V(x) − V(x̃) = ½ δᵀP δ + gᵀδ,      δ = x − x̃,   g = P x̃ + q

does not cancel near the optimum x*. Any x̃ within the bounds will do, since strong convexity bounds what it lacks:

    0 ≤ V(x̃) − V* ≤ ‖S r‖² / 2λ,      r the part of g that no bound holds,   0 < λ ≤ λ_min(S P S)

with any diagonal S (Boyd, Vandenberghe, *Convex Optimization*, 2004, section 9.1.2, for each variable within its
bounds); here S P S has a unit diagonal. Rounding errors are below γ_n = n u / (1 − n u) times the sum of the absolute
values of the terms (Higham, *Accuracy and Stability of Numerical Algorithms*, 2002, section 3.1).
"""

import math

import numpy as np

from bench.problems.protocol import CertifiedForm
from solvers.arrays import Matrix, Vector

UNIT = np.finfo(float).eps / 2.0
"""Unit roundoff u."""
Bounds = tuple[Vector, Vector]
"""Lower and upper bounds, each of shape (n,)."""


def has_bounds_only(form: CertifiedForm) -> bool:
    """Whether the gaps of a program can be bounded here, a definite P aside."""
    return form.qp.G is None and form.qp.A is None and isinstance(form.qp.P, np.ndarray)


def scale_of(form: CertifiedForm) -> Vector:
    """The diagonal of S for all programs, shape (d,)."""
    diagonal = np.diag(form.qp.P)
    return 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))


def least_eigenvalues(form: CertifiedForm) -> Vector:
    """A lower bound of λ_min(S P S) of the program and of each of its windows, shape (1 + windows,)."""
    scale = scale_of(form)
    every = np.stack([form.qp.P, *(window.P for window in form.windows)]) * np.outer(scale, scale)
    rounding = 8.0 * form.qp.q.size * UNIT * np.linalg.norm(every, axis=(1, 2))
    return np.asarray(np.linalg.eigvalsh(every)[:, 0] - rounding)


def gap_bounds(form: CertifiedForm, P: Matrix, q: Matrix, c: Vector, least: Vector, x: Matrix, near: Matrix) -> Bounds:
    """Bounds of the larger of relative cost gap and relative violation, as `bench.races.metrics` defines them.

    Parameters
    ----------
    form : CertifiedForm
        Its bounds and its unit of cost hold for all programs.
    P, q, c, least : arrays
        n programs with their constants, and lower bounds of λ_min(S P S): (n, d, d) or (1, d, d), (n, d), (n,), (n,).
    x : array, shape (n, d)
        An answer to each.
    near : array, shape (n, d)
        A point within the bounds, near the optimum of each; NaN if there is none.

    Returns
    -------
    low, high : array, shape (n,)
        From 0 to ∞ where nothing is known, and ∞ for an answer that is not finite.
    """
    d = q.shape[1]
    lb, ub = (
        np.full(d, end) if bound is None else bound for bound, end in ((form.qp.lb, -np.inf), (form.qp.ub, np.inf))
    )
    gamma, gamma_g = ((n := terms * UNIT) / (1.0 - n) for terms in (4 * d + 16, d + 2))
    with np.errstate(all="ignore"):
        feasible = np.clip(x, lb, ub)
        delta, g, sizes = (
            feasible - near,
            np.vecdot(P, near[:, None]) + q,
            np.vecdot(np.abs(P), np.abs(near)[:, None]) + np.abs(q),
        )
        gap = np.vecdot(np.vecdot(P, delta[:, None]), delta) / 2.0 + np.vecdot(g, delta)
        error = gamma * np.vecdot(np.vecdot(np.abs(P), np.abs(delta)[:, None]) / 2.0 + sizes, np.abs(delta))
        uncertain = gamma_g * sizes
        below = np.where(near > lb, g + uncertain, 0.0).clip(min=0.0)
        above = np.where(near < ub, uncertain - g, 0.0).clip(min=0.0)
        scale = scale_of(form)
        r = (1.0 + gamma) * np.linalg.norm(scale * np.maximum(below, above), axis=1)
        lacks, moved = r**2 / (2.0 * least), scale.max() * r / least
        value, slope = np.vecdot(np.vecdot(P, near[:, None]), near) / 2.0, np.vecdot(q, near)
        unsure = gamma * (np.vecdot(sizes, np.abs(near)) + np.abs(c)) + lacks
        cost, floor = np.maximum(value, np.abs(slope)), np.full(1, -np.inf)
        if form.cost_unit == 0.0:
            cost, floor = value + slope + c, np.maximum(2.0 * UNIT * np.abs(c), np.finfo(float).tiny)
        costs = [np.maximum(cost + sign * unsure, floor) for sign in (-1.0, 1.0)]
        size = np.abs(near).max(axis=1)
        violation = np.abs(x - feasible).max(axis=1)
        low = np.maximum(np.maximum(gap - error, 0.0) / costs[1], violation * (1.0 - gamma) / (size + moved))
        high = np.maximum((gap + error + lacks) / costs[0], violation * (1.0 + gamma) / (size - moved))
    known = (least > 0.0) & np.isfinite(near).all(axis=1) & (costs[0] > 0.0) & (size > moved) & np.isfinite(low + high)
    wrong = ~np.isfinite(x).all(axis=1)
    return np.where(wrong, math.inf, np.where(known, low, 0.0)), np.where(known & ~wrong, high, math.inf)
