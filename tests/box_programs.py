"""Random box-constrained programs with every kind of bounds, judged by the exact optimum, and a linear program."""

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray
from qpsolvers import Problem

from solvers import Solver, get
from solvers.certificate import certify, exact_cost_gap

Array = NDArray[np.float64]
INF = np.inf
seeds = st.integers(0, 2**32 - 1)


def spectrum_matrix(rng: np.random.Generator, d: int, decades: float) -> Array:
    """A symmetric d × d matrix with eigenvalues from 1 down to 10^-decades."""
    U = np.linalg.qr(rng.normal(size=(d, d)))[0]
    P: Array = U * 10 ** -(decades * np.linspace(0, 1, d)) @ U.T
    return (P + P.T) / 2


def random_program(seed: int, d: int, decades: float) -> tuple[Array, Array, Array, Array]:
    """P, q, lb, ub of free, one-sided, two-sided and fixed variables; q is usually in the range of P."""
    rng = np.random.default_rng(seed)
    P, lb = spectrum_matrix(rng, d, decades), np.where(rng.random(d) < 0.7, rng.normal(size=d), -INF)
    ub = np.where(rng.random(d) < 0.4, np.where(np.isfinite(lb), lb, 0) + np.abs(rng.normal(size=d)), INF)
    fixed = rng.random(d) < 0.1
    q = -P @ rng.normal(size=d) if rng.random() < 0.7 else rng.normal(size=d)
    return P, q, np.where(fixed, 0.5, lb), np.where(fixed, 0.5, ub)


def set_up(name: str, problem: Problem, **settings: object) -> Solver:
    """A solver that is ready for a program."""
    solver = get(name, **settings)
    solver.setup(problem)
    return solver


def optimum(problem: Problem) -> Array:
    """The answer of the exact solver."""
    return set_up("box_active_set", problem).solve().copy()


def inside(x: Array, lb: Array, ub: Array) -> bool:
    """Whether x satisfies all bounds exactly."""
    return bool(((lb <= x) & (x <= ub)).all())


def relative_gap(P: Array, q: Array, lb: Array, ub: Array, x: Array, least: float = 1e-3) -> float:
    """(f(x) − f*) / max(|f*|, least |q|ᵀ|x|), every sum exact, of an answer within its bounds."""
    assert inside(x, lb, ub)
    problem = Problem((P + P.T) / 2, q, lb=lb, ub=ub)
    proof = certify(problem, x)
    size = max(abs(proof.value_rounded), least * float(np.abs(q) @ np.abs(x)), 1e-300)
    return exact_cost_gap(problem, proof, x).absolute / size


def many_weak_rows() -> Problem:
    """A linear program whose optimum, 0, is proven with 3e5 bit operations and known to be unique with 3e6 more."""
    G = np.vstack([np.random.default_rng(0).integers(-3, 4, size=(16, 8)), -np.eye(8)[:1]])
    return Problem(np.zeros((8, 8)), np.eye(8)[0], G.astype(float), np.zeros(17))
