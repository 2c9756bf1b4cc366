"""Solvers that are one function call on a problem with bounds only and know no duals.

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub

Files of this folder that begin with an underscore are shared parts, not solvers.
"""

from abc import abstractmethod
from typing import NamedTuple

import numpy as np

from solvers.adapter import Answer, LibrarySolver, Program, Stack
from solvers.protocol import Vector, box_duals


class Outcome(NamedTuple):
    """What a library said about its last call, in our words."""

    x: Vector
    found: bool
    status: str
    iterations: int | None = None


class BoxMinimiser(LibrarySolver):
    """A solver with bounds only; a file of one fills in ``minimise``."""

    bounds_only = True

    def build(self, p: Program, rows: Stack) -> None:
        self.lb, self.ub = p.lb, p.ub
        self.empty = bool(np.any(p.lb > p.ub))

    @abstractmethod
    def minimise(self, start: Vector | None) -> Outcome:
        """Call the library on a box that is not empty."""

    def solve(self, warm_start: Vector | None = None) -> Vector:
        # On an empty box some libraries raise and some return a corner; here all say the same.
        self.outcome = (
            Outcome(self.program.no_answer(), False, "infeasible: lb > ub") if self.empty else self.minimise(warm_start)
        )
        self.found = self.outcome.found
        return self.outcome.x if self.found else self.program.no_answer()

    def answer(self) -> Answer:
        x, _, status, iterations = self.outcome
        return Answer(x, box_duals(cost(self.program, x)[1], self.lb, self.ub, x), status, iterations)


def cost(program: Program, x: Vector) -> tuple[float, Vector]:
    """½ xᵀP x + qᵀx and its gradient P x + q, shape (d,)."""
    Px = program.P @ x
    return float(0.5 * x @ Px + program.q @ x), Px + program.q


def inside(start: Vector | None, lb: Vector, ub: Vector) -> Vector:
    """The point of the box next to the warm start, or next to 0 where there is none, shape (d,)."""
    return np.clip(np.zeros_like(lb) if start is None else start, lb, ub)


def bound_duals(gradient: Vector, lb: Vector, ub: Vector) -> Vector:
    """z_box = −gradient wherever a finite bound can carry that sign, zero elsewhere, shape (d,).

    For answers that come close to their bounds without touching them: stationarity then holds, and the distance to
    the bound shows in the duality gap. The rule of :func:`solvers.protocol.box_duals` (exactly touched bounds only)
    reports a dual residual of the size of the gradient for such an answer, however good it is.
    """
    below, above = np.maximum(gradient, 0.0), np.minimum(gradient, 0.0)
    return -np.where(np.isfinite(lb), below, 0.0) - np.where(np.isfinite(ub), above, 0.0)
