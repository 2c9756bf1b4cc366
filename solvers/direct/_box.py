"""Solvers that are one function call on a problem with bounds only, without duals.

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub

Files of this folder that begin with an underscore are shared parts, not solvers.
"""

from abc import abstractmethod

import numpy as np

from solvers.adapter import LibrarySolver, Program, Report
from solvers.protocol import Vector, box_duals

BoxResult = tuple[Vector, bool, str, int | None]
"""x, whether the library calls it found, its status and its number of iterations."""


class BoxMinimiser(LibrarySolver):
    """A solver of problems with bounds only; a subclass defines ``minimise``."""

    bounds_only = True

    @abstractmethod
    def minimise(self, start: Vector | None) -> BoxResult:
        """Call the library."""

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self.outcome = self.minimise(warm_start)
        return self.outcome[0]

    def report(self) -> Report:
        x, found, status, iterations = self.outcome
        return Report(
            found, box_duals(cost(self.program, x)[1], self.program.lb, self.program.ub, x), status, iterations
        )


def cost(program: Program, x: Vector) -> tuple[float, Vector]:
    """½ xᵀP x + qᵀx and its gradient P x + q, shape (d,)."""
    Px = program.P @ x
    return float(0.5 * x @ Px + program.q @ x), Px + program.q


def inside(start: Vector | None, lb: Vector, ub: Vector) -> Vector:
    """The point of the box nearest to the warm start, or to 0 without one, shape (d,)."""
    return np.clip(np.zeros_like(lb) if start is None else start, lb, ub)
