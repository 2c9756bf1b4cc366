"""The row of the error model (5) that one sample gives, linear in the unknowns w:

    E(k) = wᵀΞ(k) + x(k),   Ξ = (H_r1[x] … H_rn[x],  −S_r'[y] …,  K_r0[x] … K_rn[x],  [1]) in unit amplitudes

Source: the paper's equation (5); K. Kuhnen, European Journal of Control 9 (2003) 407–418.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezo_model.core import State, bindings
from piezo_model.identification_problem import Coordinates
from piezo_model.operator_state import OperatorArrays, OperatorState, SuperpositionArrays
from piezo_model.structure import ModelStructure
from solvers.arrays import Matrix, Vector
from solvers.core import padded


class RegressorArrays(NamedTuple):
    """Parameters of the regressor row as the core takes them."""

    operators: OperatorArrays
    dead_zones: SuperpositionArrays
    outer: SuperpositionArrays
    """Dead zones to be taken off: the next ones outwards for slope coordinates, nothing for weights."""
    n: int
    width: int
    """d + 1."""
    offset: bool
    zones: int

    @classmethod
    def of(cls, s: ModelStructure, coordinates: Coordinates = "weight") -> RegressorArrays:
        """Parameters of a structure; in slope coordinates the row is that of v = T⁻¹ w, Ξ_v = Tᵀ Ξ."""
        r_S = np.array(s.dead_zone_thresholds)
        zones = SuperpositionArrays.of(np.ones_like(r_S), r_S)
        outer = SuperpositionArrays(np.full_like(zones.low, -np.inf), np.full_like(zones.high, np.inf), zones.w)
        if coordinates == "slope":
            low, high, middle, last = zones.low, zones.high, s.middle, s.dead_zones - 1
            outer.low[1:middle], outer.high[1:middle] = low[: max(middle - 1, 0)], high[: max(middle - 1, 0)]
            outer.low[middle + 1 : last], outer.high[middle + 1 : last] = (
                low[middle + 2 : last + 1],
                high[middle + 2 : last + 1],
            )
            # The piece around zero ends at the next threshold on both sides.
            outer.low[middle] = low[middle - 1] if middle > 0 else -np.inf
            outer.high[middle] = high[middle + 1] if middle < last else np.inf
        return cls(OperatorArrays.of(s), zones, outer, s.n, s.d + 1, s.offset, s.dead_zones)

    def new_core(self, forgetting: float = 1.0) -> State:
        """The data basis of ``core/data_basis.h`` with these parameters."""
        shape = self.n, self.zones, self.operators.rates, int(self.offset)
        core = State(bindings.basis_bytes(*shape), lambda block: bindings.basis_setup(block, *shape, forgetting))
        self.write(core)
        return core

    def write(self, core: State) -> None:
        """Write them to a state of the core that has regressors."""
        for name, values in (
            ("r", self.operators.r),
            ("a", self.operators.a),
            ("low", self.dead_zones.low),
            ("high", self.dead_zones.high),
            ("outer_low", self.outer.low),
            ("outer_high", self.outer.high),
        ):
            core[name][:] = values

    @property
    def stride(self) -> int:
        """Length of a row in memory: blocks of eight are written and read beyond the last column."""
        return padded(self.width + 1) + 8


def regressor_rows(structure: ModelStructure, state: OperatorState, x: Vector, y: Vector) -> Matrix:
    """Rows (x, Ξ) of samples in the structure's units, shape (N, d + 1), in unit amplitudes; the state moves on."""
    p = RegressorArrays.of(structure)
    core, rows = p.new_core(), np.empty((x.size, p.stride))
    core["play"][:], core["creep"][:] = state.play, state.creep
    bindings.basis_rows(
        core.block, *(np.ascontiguousarray(v) for v in (structure.unit_input(x), structure.unit_output(y))), rows
    )
    state.play[:], state.creep[:] = core["play"], core["creep"]
    return rows[:, : p.width].copy()
