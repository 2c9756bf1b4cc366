"""Random box programs of every kind with the exact solver: found answers meet the optimality conditions, and refused
programs have no optimum."""

from fractions import Fraction

import numpy as np
import pytest
from qpsolvers import Problem

from solvers import get
from solvers.certificate import NotCertified, certify

INF = np.inf
CONTRADICTED = {5741}
"""Programs that are refused though their optimum is certified, a miss: a Hilbert matrix of 20, four eigenvalues
negative by rounding."""


def random_program(seed):
    """P, q, lb, ub of 1 to 200 variables, mostly few: spectra down to 1e-14, ties, integers, Hilbert matrices, singular
    P."""
    rng = np.random.default_rng(seed)
    d = int(rng.integers(1, 201)) if rng.random() < 0.15 else int(rng.integers(1, 25))
    kind = rng.choice(["spectrum", "integers", "hilbert", "singular", "ties"])
    if kind == "spectrum":
        U = np.linalg.qr(rng.normal(size=(d, d)))[0]
        P = U * 10 ** -(rng.uniform(0, 14) * np.linspace(0, 1, d)) @ U.T
    elif kind == "integers":
        A = rng.integers(-2, 3, (d, d))
        P = (A @ A.T + rng.integers(0, 2) * np.eye(d)).astype(float)
    elif kind == "hilbert":
        P = 1.0 / (np.arange(d)[:, None] + np.arange(d) + 1.0)
        P = np.round(P, int(rng.integers(6, 16))) if rng.random() < 0.5 else P
    elif kind == "singular":
        A = rng.normal(size=(d, int(rng.integers(0, d + 1))))
        P = A @ A.T
    else:
        k = max(1, d // 3)
        B = rng.normal(size=(k, k))
        P = np.kron(np.eye(-(-d // k)), B @ B.T + 0.1 * np.eye(k))[:d, :d]
    P = (P + P.T) / 2
    lb = np.where(rng.random(d) < 0.7, np.round(rng.normal(size=d), 1), -INF)
    ub = np.where(rng.random(d) < 0.4, np.where(lb > -INF, lb, 0) + np.round(np.abs(rng.normal(size=d)), 1), INF)
    if rng.random() < 0.3:
        lb, ub = np.full(d, -1.0), np.full(d, 1.0)
    q = -P @ rng.normal(size=d) if rng.random() < 0.7 else rng.normal(size=d)
    return P, np.round(q) if kind in ("integers", "ties") else q, lb, ub


def violation(P, q, lb, ub, x):
    """The largest violation of the optimality conditions in extended precision, relative to the largest terms of a
    gradient."""
    g = P.astype(np.longdouble) @ x + q
    wrong = np.where(lb == ub, 0, np.where(x <= lb, np.minimum(g, 0), np.where(x >= ub, np.maximum(g, 0), g)))
    size = np.abs(P) @ np.abs(x) + np.abs(q)
    return float(np.abs(wrong).max(initial=0) / max(size.max(initial=0), 1e-300))


def is_refuted(P, q, lb, ub, sentence):
    """Whether the certificate contradicts a refusal: an optimum is proved, and the curvature of P towards it is above
    rounding."""
    try:
        proof = certify(Problem(P, q, lb=lb, ub=ub), np.clip(np.zeros(q.size), lb, ub))
    except NotCertified:
        return False
    x = [Fraction(entry) for entry in proof.x]
    curvature = sum(x[i] * x[j] * Fraction(P[i, j]) for i in range(q.size) for j in range(q.size)) / (
        sum(v * v for v in x) or 1
    )
    return "indefinite" in sentence or curvature > Fraction(q.size * np.finfo(float).eps * P.diagonal().max())


def sweep(seeds):
    """The number of programs with an answer, and the programs that contradict one of the two statements."""
    found, wrong = 0, []
    for seed in seeds:
        P, q, lb, ub = random_program(seed)
        solver = get("box_active_set", "kernel")
        try:
            solver.setup(Problem(P, q, lb=lb, ub=ub))
            x, solution = solver.solve().copy(), solver.solution()
        except ValueError as refusal:
            if q.size <= 24 and is_refuted(P, q, lb, ub, str(refusal)):
                wrong.append((seed, str(refusal)))
            continue
        inside = ((lb <= solution.x) & (solution.x <= ub)).all() and ((lb <= x) & (x <= ub)).all()
        found += solution.found
        if not inside or (solution.found and violation(P, q, lb, ub, solution.x) > 1e-12):
            wrong.append((seed, violation(P, q, lb, ub, solution.x)))
    return found, wrong


def test_found_answers_are_optimal_and_refused_programs_have_no_optimum():
    found, wrong = sweep(range(400))
    assert wrong == []
    assert found > 340


@pytest.mark.nightly
def test_sixteen_thousand_programs_are_solved_or_refused_rightly():
    found, wrong = sweep(range(400, 16_000))
    assert {seed for seed, _ in wrong} <= CONTRADICTED
    assert found > 13_500
