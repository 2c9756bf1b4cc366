"""Solvers that are one function call on a problem with bounds only and know no duals.

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub

Files of this folder that begin with an underscore are shared parts, not solvers.
"""

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from qpsolvers import Problem, Solution

from solvers.backend import LibrarySolver
from solvers.protocol import Unsupported, Vector, box_solution, only_box
from solvers.rows import Program


@dataclass
class Outcome:
    """What a library said about its last call, in our words."""

    x: Vector
    found: bool
    status: str
    iterations: int | None = None
    reported_us: float | None = None

    def extras(self) -> dict[str, object]:
        """The entries of ``Solution.extras``."""
        return {"status": self.status, "reported_us": self.reported_us, "iterations": self.iterations}


class BoxMinimiser(LibrarySolver):
    """A solver with bounds only; a file of one fills in ``minimise``."""

    def setup(self, problem: Problem) -> None:
        self.lb, self.ub = only_box(problem, self.name)
        self.program = Program(problem)
        self.empty = bool(np.any(self.lb > self.ub))

    @abstractmethod
    def minimise(self, start: Vector | None) -> Outcome:
        """Call the library on a box that is not empty."""

    def solve(self, warm_start: Vector | None = None) -> Vector:
        # On an empty box some libraries raise and some return a corner; here all say the same.
        self.outcome = (
            Outcome(self.program.no_answer(), False, "infeasible: lb > ub") if self.empty else self.minimise(warm_start)
        )
        return self.outcome.x if self.outcome.found else self.program.no_answer()

    def solution(self) -> Solution:
        problem = Problem(self.program.P.copy(), self.program.q.copy(), lb=self.lb, ub=self.ub)
        if not self.outcome.found:
            return Solution(problem, found=False, extras=self.outcome.extras())
        return box_solution(problem, self.outcome.x, True, **self.outcome.extras())


def refuse_crossing(program: Program, name: str) -> None:
    """Raise :class:`Unsupported` for a library that refuses bounds that cross instead of calling them infeasible."""
    if np.any(program.l > program.u):
        raise Unsupported(f"{name} refuses bounds that cross, and a lower bound of the problem is above its upper one")


def cost(program: Program, x: Vector) -> tuple[float, Vector]:
    """½ xᵀP x + qᵀx and its gradient P x + q, shape (d,)."""
    Px = program.P @ x
    return float(0.5 * x @ Px + program.q @ x), Px + program.q


def inside(start: Vector | None, lb: Vector, ub: Vector) -> Vector:
    """The point of the box next to the warm start, or next to 0 where there is none, shape (d,)."""
    point: Vector = np.clip(np.zeros_like(lb) if start is None else start, lb, ub)
    return point


def bound_duals(gradient: Vector, lb: Vector, ub: Vector) -> Vector:
    """z_box = −gradient wherever a finite bound can carry that sign, zero elsewhere, shape (d,).

    For answers that come close to their bounds without touching them: stationarity then holds, and the distance to
    the bound shows in the duality gap. The rule of :func:`solvers.protocol.box_solution` (exactly touched bounds only)
    reports a dual residual of the size of the gradient for such an answer, however good it is.
    """
    below, above = np.maximum(gradient, 0.0), np.minimum(gradient, 0.0)
    return -np.where(np.isfinite(lb), below, 0.0) - np.where(np.isfinite(ub), above, 0.0)
