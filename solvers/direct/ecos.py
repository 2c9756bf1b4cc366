"""ECOS: interior point method on second-order cones.

    minimise qᵀx + t   subject to   A x = b,  G x ≤ h,  ‖(√2 Lᵀx, t − 1)‖ ≤ t + 1;   P = L Lᵀ

The cone states ½ xᵀP x ≤ t. Since q and t stand in the cost, the multipliers of A and G are those of the quadratic
program.

Source: A. Domahidi, E. Chu, S. Boyd, "ECOS: an SOCP solver for embedded systems", European Control Conference (2013).

Timed: ``setup`` and ``update`` factorise P and build the cone; ``solve`` is the library's function, which sets up and
iterates. There is no warm start. The square inside the cone costs accuracy: the smallest error of x is about 1e-5.
"""

import ecos
import numpy as np
from scipy.sparse import csc_matrix

from solvers.adapter import Cones, LibrarySolver, Matrix, Program, Report, Vector
from solvers.backend import ECOS
from solvers.direct._least_squares import cholesky


class Ecos(LibrarySolver):
    """The library's ``solve``; P must be positive definite."""

    library = ECOS
    reads_given_arrays = True
    form = Cones

    def build(self, p: Program, rows: Cones) -> None:
        n, m, d = rows.equal, rows.unequal, p.d
        self._cost = np.ones(d + 1)
        self._h = np.concatenate([rows.r[n:], [1.0], np.zeros(d), [-1.0]])
        self._dims = {"l": m, "q": [d + 2]}
        self._equalities = (csc_matrix(np.pad(rows.R[:n], ((0, 0), (0, 1)))), rows.r[:n]) if n else (None, None)
        G = np.zeros((m + d + 2, d + 1))
        G[:m, :d] = rows.R[n:]
        G[[m, -1], d] = -1.0
        G[m + 1 : -1, :d][np.triu_indices(d)] = 1.0
        self._G = G = csc_matrix(G)
        column = np.repeat(np.arange(d + 1), np.diff(G.indptr))
        self._factor = np.flatnonzero((G.indices > m) & (column < d))  # places of the factor of P
        self.pass_data(p.P, p.q)

    def pass_data(self, P: Matrix | None, q: Vector | None) -> None:
        if q is not None:
            self._cost[:-1] = q
        if P is not None:
            # Lᵀ column by column is L row by row
            self._G.data[self._factor] = -np.sqrt(2.0) * self.program.triangle.values(cholesky(P, self.name))

    def call_library(self, warm_start: Vector | None) -> Vector | None:
        self._result = ecos.solve(
            self._cost, self._G, self._h, self._dims, *self._equalities, verbose=False, **self.settings
        )
        return self._result["x"][:-1] if self._result["info"]["exitFlag"] == 0 else None

    def report(self) -> Report:
        r, info = self._result, self._result["info"]
        w = np.concatenate([r["y"], r["z"][: self.rows.unequal]])
        return Report(r["x"][:-1], w, info["infostring"], info["iter"], 1e6 * info["timing"]["tsolve"])
