"""out = c + M x, the product on which every kernel here spends its time.

M is stored by columns, padded to a multiple of eight rows; up to three such blocks stay in registers while the
columns pass by in pairs, so that nothing but M and x is read in the loop and no sum waits for the one before it.
"""

from __future__ import annotations

from solvers.compiled import compiled, inlined, literal
from solvers.kernels.vector import broadcast, fma, load, store
from solvers.protocol import Matrix
from solvers.vector8 import splat8


@compiled
def affine(work: Matrix, columns: int, d: int, x: int, c: int, out: int) -> None:
    """work[out] = work[c] + Σ_{j<d} work[columns + j] work[x, j], all of them rows of one array.

    Where d is odd, row columns + d is read too and must be finite, and work[x, d] must be zero.
    """
    width, b = work.shape[1], 0
    while b + 24 < width:
        _affine_blocks(work, columns, d, x, c, out, b, 2)
        b += 16
    if b + 24 == width:
        _affine_blocks(work, columns, d, x, c, out, b, 3)
    elif b + 16 == width:
        _affine_blocks(work, columns, d, x, c, out, b, 2)
    else:
        _affine_blocks(work, columns, d, x, c, out, b, 1)


@inlined
def _affine_blocks(work: Matrix, columns: int, d: int, x: int, c: int, out: int, b: int, blocks: int) -> None:
    last = b + 8 * blocks - 8
    a0, a1, a2 = load(work, c, b), load(work, c, last - 8), load(work, c, last)
    e0, e1, e2 = splat8(0.0), splat8(0.0), splat8(0.0)
    for j in range(0, d, 2):
        t, u, m = broadcast(work, x, j), broadcast(work, x, j + 1), columns + j
        a2, e2 = fma(load(work, m, last), t, a2), fma(load(work, m + 1, last), u, e2)
        if blocks > 1:
            a0, e0 = fma(load(work, m, b), t, a0), fma(load(work, m + 1, b), u, e0)
        if blocks > 2:
            a1, e1 = fma(load(work, m, b + 8), t, a1), fma(load(work, m + 1, b + 8), u, e1)
    store(work, out, last, a2 + e2)
    if blocks > 1:
        store(work, out, b, a0 + e0)
    if blocks > 2:
        store(work, out, b + 8, a1 + e1)


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
