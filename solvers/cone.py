"""The exact Euclidean projection onto {x : G x ≤ h, lb ≤ x ≤ ub}: a polyhedron split into bounds and rows that couple variables.

A variable that appears in no row of G is clipped to its bounds. The others are coupled: their rows and their finite bounds are
A x ≤ b, onto which ``solvers/core/cone.c`` projects by the dual. A row with one entry is a bound and becomes one, a row that repeats
another merges with it.
"""

from __future__ import annotations

import numpy as np

from solvers.core import OK, block, face
from solvers.protocol import Matrix, Vector

EMPTY = "the constraints are infeasible: no point fulfils every row of G and every bound"


class Cone:
    """A polyhedron split into bounds of single variables and rows that couple some of them.

    Parameters
    ----------
    G, h : arrays, shapes (rows, d) and (rows,), or None
        General inequalities G x ≤ h.
    lb, ub : arrays, shape (d,)
        Bounds, infinite where there is none.

    Attributes
    ----------
    lo, hi : arrays, shape (d,)
        Bounds of the variables that are clipped; infinite for the coupled ones.
    index : array, shape (c,)
        The coupled variables.
    A, b : arrays, shapes (r, c) and (r,)
        Their rows, of length one.
    lengths : array, shape (r,)
        The lengths that the rows had.
    sources : list of int
        Where each row comes from: its number in G, or −1 − 2 j for lb_j and −2 − 2 j for ub_j.
    state : array of bytes, or None
        The projection of the coupled variables in C; None where there are none.

    Raises
    ------
    ValueError
        A number is NaN, bounds cross, or a row of zeros cannot hold.
    """

    def __init__(self, G: Matrix | None, h: Vector | None, lb: Vector, ub: Vector) -> None:
        d = lb.size
        G, h = (np.zeros((0, d)), np.zeros(0)) if G is None or h is None else (G, h)
        if not np.isfinite(G).all() or np.isnan(h).any() or np.isnan(lb).any() or np.isnan(ub).any():
            raise ValueError("G must be finite and h and the bounds must not be NaN")
        self.G, self.h, self.lb, self.ub = G, h, lb, ub
        lo, hi = lb.copy(), ub.copy()
        entries = np.count_nonzero(G, axis=1)
        self.single = {int(i): int(np.flatnonzero(G[i])[0]) for i in np.flatnonzero(entries == 1)}
        """Rows of G that are bounds, and of which variable."""
        for i, j in self.single.items():
            if G[i, j] > 0:
                hi[j] = min(hi[j], h[i] / G[i, j])
            else:
                lo[j] = max(lo[j], h[i] / G[i, j])
        crossed = (lo > hi) | (lo == np.inf) | (hi == -np.inf)
        if crossed.any():
            raise ValueError(f"the bounds of variable {int(np.argmax(crossed))} cross")
        if (h[entries == 0] < 0).any() or np.isneginf(h).any():
            raise ValueError("a row of G is zero with a negative h, or an h is -inf, so the problem is infeasible")
        general = np.flatnonzero((entries > 1) & (h < np.inf))
        self.index = np.flatnonzero(G[general].any(axis=0)).astype(np.int64)
        rows = {int(i): (G[i, self.index], float(h[i])) for i in general}
        for unit, variable in zip(np.eye(self.index.size), self.index.tolist(), strict=True):
            if np.isfinite(lo[variable]):
                rows[-1 - 2 * variable] = (-unit, -float(lo[variable]))
            if np.isfinite(hi[variable]):
                rows[-2 - 2 * variable] = (unit, float(hi[variable]))
        merged: dict[bytes, tuple[int, Vector, float, float]] = {}
        for source, (row, limit) in rows.items():
            length = float(np.linalg.norm(row))
            row = row / length
            key = (np.round(row, 14) + 0.0).tobytes()
            if key not in merged or limit / length < merged[key][2]:
                merged[key] = source, row, limit / length, length
        self.sources = [source for source, *_ in merged.values()]
        self.A = np.array([row for _, row, *_ in merged.values()]).reshape(len(merged), self.index.size)
        self.b = np.array([limit for *_, limit, _ in merged.values()])
        self.lengths = np.array([length for *_, length in merged.values()])
        self.tight_lo, self.tight_hi = lo.copy(), hi.copy()
        lo[self.index], hi[self.index] = -np.inf, np.inf
        self.lo, self.hi = lo, hi
        self.state = block(face.cone_bytes(self.b.size, self.index.size)) if self.b.size else None
        if self.state is not None:
            face.cone_setup(self.state, self.A, self.b, self.index)

    @property
    def dual(self) -> Vector:
        """λ of the last projection, shape (r,), for the rows A."""
        found = np.zeros(self.b.size)
        if self.state is not None:
            face.cone_multipliers(self.state, found)
        return found

    def project(self, v: Vector) -> Vector:
        """The nearest point of the polyhedron to v, shape (d,).

        Raises
        ------
        ValueError
            The polyhedron is empty.
        """
        x = np.minimum(np.maximum(v, self.lo), self.hi)
        if face.cone_project(x, self.state) != OK:
            raise ValueError(EMPTY)
        return x

    def multipliers(self, x: Vector, gradient: Vector, eta: float) -> tuple[Vector, Vector]:
        """Duals (z, z_box), shapes (rows of G,) and (d,), of a point x where x = Proj(x − eta gradient)."""
        z = np.zeros(self.h.size)
        at_lo, at_hi = x <= self.lo, x >= self.hi
        z_box = np.where(at_lo & (gradient > 0) | at_hi & (gradient < 0), -gradient, 0.0)
        for source, value in zip(self.sources, self.dual / (self.lengths * eta), strict=True):
            if source >= 0:
                z[source] = value
            else:
                z_box[(-1 - source) // 2] += value if source % 2 == 0 else -value
        for i, j in self.single.items():
            entry = self.G[i, j]
            bound, own = (self.tight_hi[j], self.ub[j]) if entry > 0 else (self.tight_lo[j], self.lb[j])
            if z_box[j] * entry > 0 and self.h[i] / entry == bound != own:
                z[i], z_box[j] = z_box[j] / entry, 0.0
        return z, z_box
