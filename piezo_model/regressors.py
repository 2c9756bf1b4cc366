"""The row of the error model (5) that one sample gives, linear in the unknowns w:

    E(k) = wᵀΞ(k) + x(k),   Ξ = (H_r1[x] … H_rn[x],  −S_r'[y] …,  K_r0[x] … K_rn[x],  [1]) in normalised units

Source: the paper's equation (5); K. Kuhnen, European Journal of Control 9 (2003) 407–418.
"""

import numpy as np

from piezo_model.core import State, bindings
from piezo_model.operator_state import OperatorState, pad, write_operators
from piezo_model.operators import dead_zone_limits
from piezo_model.structure import ModelStructure
from solvers.arrays import Matrix, Vector
from solvers.core import padded


def outer_limits(s: ModelStructure) -> tuple[Vector, Vector]:
    """Limits (low, high) of the dead zones that are subtracted in slope coordinates: those of the next threshold
    outwards, and for the piece around zero those on both sides."""
    low, high = dead_zone_limits(s.dead_zone_thresholds)
    outer_low, outer_high = np.full_like(low, -np.inf), np.full_like(high, np.inf)
    outer_low[1 : s.middle + 1] = low[: s.middle]
    outer_high[s.middle : -1] = high[s.middle + 1 :]
    return outer_low, outer_high


def write_slope_regressors(core: State, s: ModelStructure) -> None:
    """Write the parameters of rows in slope coordinates v = T⁻¹ w, Ξ_v = Tᵀ Ξ, to a state of the core."""
    write_operators(core, s, s.dead_zone_thresholds)
    low, high = outer_limits(s)
    core["outer_low"][:] = pad(low, padded(low.size), -np.inf)
    core["outer_high"][:] = pad(high, padded(high.size), np.inf)


def new_basis(s: ModelStructure, forgetting: float = 1.0) -> State:
    """A data basis of ``core/data_basis.h`` in weight coordinates."""
    core = State(bindings.basis_bytes(*s.shape), lambda block: bindings.basis_setup(block, *s.shape, forgetting))
    write_operators(core, s, s.dead_zone_thresholds)
    core["outer_low"][:], core["outer_high"][:] = -np.inf, np.inf
    return core


def full_gram(upper: Vector, s: ModelStructure) -> Matrix:
    """Symmetric matrix (d + 1, d + 1) of the core's Gram matrix, which has the upper triangle only."""
    gram = np.triu(upper.reshape(s.d + 1, padded(s.d + 1))[:, : s.d + 1])
    return np.asarray(gram + np.triu(gram, 1).T)


class Regressors:
    """Rows (x, Ξ) of consecutive samples from the states before them, in normalised units and weight or slope
    coordinates."""

    def __init__(self, structure: ModelStructure, state: OperatorState, *, slopes: bool = False) -> None:
        self._d, self._core = structure.d, new_basis(structure)
        if slopes:
            write_slope_regressors(self._core, structure)
        self._core["play"][:], self._core["creep"][:] = state.play, state.creep

    def rows(self, unit_x: Vector, unit_y: Vector) -> Matrix:
        """The rows (N, d + 1) of the next samples (N,)."""
        rows = np.empty((unit_x.size, padded(self._d + 2) + 8))  # the core writes blocks of eight beyond the last one
        bindings.basis_rows(self._core.block, unit_x, unit_y, rows)
        return rows[:, : self._d + 1]

    def advance(self, unit_x: Vector) -> None:
        """Pass over the next samples (N,)."""
        bindings.basis_update(self._core.block, unit_x, np.full(unit_x.size, np.nan))
