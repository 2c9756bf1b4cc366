"""Pairs of quadratic programs constructed from their answers, so that the optimum is known without a solver.

    q = −P x − Rᵀw,   w_i > 0 only where row i of R = (I; A; G) is at its upper side, w_i < 0 only at its lower side,

so x is the optimum by the Karush-Kuhn-Tucker conditions, and the only one since P is positive definite. The two
problems of a pair share their constraints and have different P, q and answers, so that a stale answer after an update
shows.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from qpsolvers import Problem

from solvers.adapter import LibrarySolver
from solvers.protocol import Matrix, Solver, Vector

FORMS = ("boxes", "one-sided", "mixed", "free", "rows")
SHARES = {
    "boxes": (1.0, 0.0, 0.0, 0.0),
    "one-sided": (0.0, 1.0, 0.0, 0.0),
    "mixed": (0.25, 0.25, 0.25, 0.25),
    "free": (0.0, 0.0, 0.0, 1.0),
    "rows": (1.0, 0.0, 0.0, 0.0),
    "mixed rows": (0.25, 0.25, 0.25, 0.25),
    "free rows": (0.0, 0.0, 0.0, 1.0),
    "fixed": (0.0, 0.0, 1.0, 0.0),
}


@dataclass
class Pair:
    """Two problems and their answers."""

    problems: list[Problem]
    answers: list[Vector]
    unit: Vector

    def error(self, x: Vector, which: int = 0) -> float:
        """Largest deviation from an answer, whose entries are at most about 2 units."""
        return float(np.abs((x - self.answers[which]) / self.unit).max())


def pair(form: str, d: int, seed: int = 0, decades: float = 0.0) -> Pair:
    """Draw a pair of d variables whose units spread over some decades; "rows" adds two equalities and d / 3
    inequalities and needs d ≥ 6."""
    rng = np.random.default_rng([seed, d, list(SHARES).index(form)])
    kind = rng.choice(["both", "lower", "fixed", "none"], size=d, p=SHARES[form])
    low, high = -rng.uniform(0.5, 1.0, d), rng.uniform(0.5, 1.0, d)
    lb = np.where(kind == "none", -np.inf, low)
    ub = np.where(kind == "both", high, np.where(kind == "fixed", low, np.inf))
    x = rng.uniform(0.9 * low, 0.9 * high, (2, d))
    touched = rng.choice([-1, 0, 1], size=(2, d), p=(0.2, 0.6, 0.2))
    x = np.where((touched < 0) & np.isfinite(lb), lb, np.where((touched > 0) & np.isfinite(ub), ub, x))
    x = np.where(kind == "fixed", low, x)
    across = x[1] - x[0]
    A = rng.normal(size=(2, d))
    A -= np.outer(A @ across, across) / max(across @ across, 1e-300)  # A x is the same at both answers
    G = rng.normal(size=(d // 3, d))
    h = (G @ x.T).max(axis=1)  # every row is active at one of the answers
    general: dict[str, Any] = {"G": G, "h": h, "A": A, "b": A @ x[0]} if form.endswith("rows") else {}
    unit = 10.0 ** np.random.default_rng(seed).uniform(-decades / 2, decades / 2, d)
    scaled = {key: value / unit if key in "GA" else value for key, value in general.items()}
    problems = []
    for at in x:
        M = rng.normal(size=(2 * d, d))
        P: Matrix = M.T @ M / d
        force = rng.uniform(0.5, 2.0, d)
        w = np.where(at == ub, force, 0.0) - np.where(at == lb, force, 0.0)
        w[kind == "fixed"] = rng.normal(size=(kind == "fixed").sum())
        if general:
            active = np.isclose(G @ at, h, rtol=0.0, atol=1e-12)
            w = w + A.T @ rng.normal(size=2) + G.T @ np.where(active, rng.uniform(0.5, 2.0, h.size), 0.0)
        problems.append(Problem(P / np.outer(unit, unit), (-P @ at - w) / unit, lb=lb * unit, ub=ub * unit, **scaled))
    return Pair(problems, list(x * unit), unit)


def arrays(problem: Problem) -> dict[str, Any]:
    """The arrays that a problem has, by name."""
    return {key: value for key, value in vars(problem).items() if value is not None}


def strided_and_locked(array: Matrix | Vector) -> Any:
    """The same numbers as every second entry of a larger array with other junk entries, read-only."""
    view = np.full(tuple(2 * n for n in array.shape), 1e3)[tuple(slice(None, None, 2) for _ in array.shape)]
    view[...] = array
    view.flags.writeable = False
    return view


FINER = {
    "highspy": {"qp_regularization_value": 1e-3},
    "highs": {"qp_regularization_value": 1e-3},
}
"""Factors by which these settings are smaller than the tolerance of the others."""


def asking(cls: type[Solver], tolerance: float | None) -> dict[str, Any]:
    """Settings with one tolerance everywhere, absolute and relative alike; none for None."""
    if tolerance is not None and issubclass(cls, LibrarySolver):
        finer = FINER.get(cls.name, {})
        names = [name for name in cls.library.tolerances if name != "cost_unit"]
        return {**{name: finer.get(name, 1.0) * tolerance for name in names}, **cls.library.rung_settings}
    is_taken = any("tolerance" in rung for rung in cls.ladder(1.0))
    return {"tolerance": tolerance} if is_taken and tolerance is not None else {}
