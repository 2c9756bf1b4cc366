"""out = c + M x, the product on which every kernel here spends its time.

M is stored by columns, padded to a multiple of eight rows; sixteen rows at a time stay in four registers while the
columns pass by in pairs, so that nothing but M and x is read in the loop and no sum waits for the one before it.
"""

from __future__ import annotations

from solvers.kernels.vector import broadcast, compiled, fma, literal, load, store
from solvers.protocol import Matrix
from solvers.vector8 import splat8


@compiled
def affine(work: Matrix, columns: int, d: int, x: int, c: int, out: int) -> None:
    """work[out] = work[c] + Σ_{j<d} work[columns + j] work[x, j], all of them rows of one array.

    Where d is odd, row columns + d is read too and must be finite, and work[x, d] must be zero.
    """
    width, b = work.shape[1], 0
    while b + 8 < width:
        a0, a1, e0, e1 = load(work, c, b), load(work, c, b + 8), splat8(0.0), splat8(0.0)
        for j in range(0, d, 2):
            t, u, m = broadcast(work, x, j), broadcast(work, x, j + 1), columns + j
            a0, a1 = fma(load(work, m, b), t, a0), fma(load(work, m, b + 8), t, a1)
            e0, e1 = fma(load(work, m + 1, b), u, e0), fma(load(work, m + 1, b + 8), u, e1)
        store(work, out, b, a0 + e0)
        store(work, out, b + 8, a1 + e1)
        b += 16
    if b < width:
        a0, e0 = load(work, c, b), splat8(0.0)
        for j in range(0, d, 2):
            a0 = fma(load(work, columns + j, b), broadcast(work, x, j), a0)
            e0 = fma(load(work, columns + j + 1, b), broadcast(work, x, j + 1), e0)
        store(work, out, b, a0 + e0)


@literal
def affine_compensated(work: Matrix, columns: int, d: int, x: int, c: int, out: int) -> None:
    """The same to about twice the precision, then rounded once (Ogita, Rump & Oishi, SIAM J. Sci. Comput. 26 (2005) 1955)."""
    for b in range(0, work.shape[1], 8):
        high, low = load(work, c, b), splat8(0.0)
        for j in range(d):
            m, t = load(work, columns + j, b), broadcast(work, x, j)
            product = m * t
            total = high + product
            part = total - high
            low = low + ((high - (total - part)) + (product - part)) + fma(m, t, 0.0 - product)
            high = total
        store(work, out, b, high + low)
