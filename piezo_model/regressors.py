"""The row of the error model (5) that one sample gives, linear in the unknowns w:

    E(k) = wᵀΞ(k) + x(k),   Ξ = (H_r1[x] … H_rn[x],  −S_r'[y] …,  K_r0[x] … K_rn[x],  [1]) in unit amplitudes

Source: the paper's equation (5); K. Kuhnen, European Journal of Control 9 (2003) 407–418.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_model.identification_problem import Coordinates
from piezo_model.operator_state import OperatorArrays, SuperpositionArrays
from piezo_model.operators import creep_step, dead_zone_step, play_step
from piezo_model.structure import ModelStructure
from solvers.compiled import inlined
from solvers.vector8 import LANES, load8, padded, splat8, store8

Vector = NDArray[np.float64]


class RegressorArrays(NamedTuple):
    """Parameters of the regressor row as the compiled kernels take them."""

    operators: OperatorArrays
    dead_zones: SuperpositionArrays
    outer: SuperpositionArrays
    """Dead zones to be taken off: the next ones outwards for slope coordinates, nothing for weights."""
    n: int
    width: int
    """d + 1."""
    offset: bool

    @classmethod
    def of(cls, s: ModelStructure, coordinates: Coordinates = "weight") -> RegressorArrays:
        """Parameters of a structure; in slope coordinates the row is that of v = T⁻¹ w, Ξ_v = Tᵀ Ξ."""
        r_S = np.array(s.dead_zone_thresholds)
        zones = SuperpositionArrays.of(np.ones_like(r_S), r_S)
        outer = SuperpositionArrays(np.full_like(zones.low, -np.inf), np.full_like(zones.high, np.inf), zones.w)
        if coordinates == "slope":
            low, high, middle, last = zones.low, zones.high, s.middle, s.dead_zones - 1
            outer.low[1:middle], outer.high[1:middle] = low[:max(middle - 1, 0)], high[:max(middle - 1, 0)]
            outer.low[middle + 1:last], outer.high[middle + 1:last] = low[middle + 2:last + 1], high[middle + 2:last + 1]
            # The piece around zero ends at the next threshold on both sides.
            outer.low[middle] = low[middle - 1] if middle > 0 else -np.inf
            outer.high[middle] = high[middle + 1] if middle < last else np.inf
        return cls(OperatorArrays.of(s), zones, outer, s.n, s.d + 1, s.offset)

    @property
    def stride(self) -> int:
        """Length of a row in memory: blocks of eight are written and read beyond the last column."""
        return padded(self.width + LANES)


@inlined
def regressor_step(p: RegressorArrays, x: float, y: float, play: Vector, creep: Vector, rows: Vector, at: int) -> None:
    """Write the row (x, Ξ) of one sample to ``rows[at:]`` and move the operator states on.

    Blocks are written from left to right, so that each one overwrites the padding of the one before it.
    """
    lanes = p.operators.r.size
    vx, vy = splat8(x), splat8(y)
    for i in range(0, lanes, 8):
        play_i = play_step(vx, load8(p.operators.r, i), load8(play, i))
        store8(play, i, play_i)
        store8(rows, at + i, play_i)
    column = at + p.n + 1
    for i in range(0, p.dead_zones.w.size, 8):
        inner = dead_zone_step(vy, load8(p.dead_zones.low, i), load8(p.dead_zones.high, i))
        store8(rows, column + i, dead_zone_step(vy, load8(p.outer.low, i), load8(p.outer.high, i)) - inner)
    if p.operators.rates > 0:
        column = at + p.width - p.offset - p.n - 1
        for i in range(0, lanes, 8):
            r, total = load8(p.operators.r, i), splat8(0.0)
            for j in range(p.operators.rates):
                z = load8(creep, j * lanes + i)
                total = total + z
                store8(creep, j * lanes + i, creep_step(vx, r, load8(p.operators.a, j * lanes + i), z))
            store8(rows, column + i, total)
    if p.offset:
        rows[at + p.width - 1] = 1.0
