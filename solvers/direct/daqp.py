"""DAQP: dual active set method on the least-distance form of a strictly convex QP, with recursive LDLᵀ updates.

    minimise ½ xᵀP x + qᵀx  s.t.  l ≤ R x ≤ u     →     minimise ½ ‖v‖²  s.t.  bounds on M v,  M = R U⁻¹,  P = UᵀU

Source: D. Arnström, A. Bemporad, D. Axehill, "A dual active-set solver for embedded quadratic programming using
recursive LDLᵀ updates", IEEE Transactions on Automatic Control 67 (2022), doi 10.1109/TAC.2022.3176430.

Timed: ``setup`` copies and factorises P; ``update`` copies P and q, factorises P again if it is new and empties the
active set; ``solve`` is the active set iteration. It starts from the rows that ``warm_start`` touches, or from none:
by default the library continues from the last active set, so a repeated problem would take no iterations.
"""

import daqp
import numpy as np
from numpy.typing import NDArray

from solvers.adapter import LibrarySolver, Matrix, Program, Report, Stack, Vector
from solvers.core import bindings

Sense = NDArray[np.intc]
IGNORED, EQUAL = 4, 5  # the library's bits: 1 active, 2 lower, 4 immutable


class Daqp(LibrarySolver):
    """The library's ``Model``."""

    warm_startable = True

    def build(self, p: Program, rows: Stack) -> None:
        self._cold = senses(p)
        self._sense = self._cold.copy()
        self._model = daqp.Model()
        if unknown := self.settings.keys() - self._model.settings.keys():
            raise ValueError(f"daqp has no setting {', '.join(sorted(unknown))}")
        self._model.settings = self.settings
        self._primal_tol: float = self._model.settings["primal_tol"]
        # The library ignores strides; these arrays are contiguous.
        self.refuse(self._model.setup(p.P, p.q, p.R[p.general], p.u, p.l, self._cold)[0])
        self._is_cold = True

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        self.refuse(self._model.update(H=P, f=q, sense=self._cold))
        self._is_cold = True

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        if warm_start is not None:
            p = self.program
            bindings.active_rows(p.R, p.l, p.u, self._primal_tol, warm_start, self._cold, self._sense)
            self._model.update(sense=self._sense)
        elif not self._is_cold:
            self._model.update(sense=self._cold)
        self._is_cold = False
        self._answer = self._model.solve()
        return self._answer[0]

    def report(self) -> Report:
        _, _, flag, info = self._answer
        return Report(flag > 0, info["lam"], f"exit flag {flag}", info["iterations"], 1e6 * info["solve_time"])


def senses(program: Program) -> Sense:
    """The library's sense of each row before a solve, shape (d + p + m,), which marks equalities and rows without
    bounds."""
    free = np.isinf(program.l) & np.isinf(program.u)
    return np.where(program.l == program.u, EQUAL, np.where(free, IGNORED, 0)).astype(np.intc)
