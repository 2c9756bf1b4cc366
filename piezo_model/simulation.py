"""Simulation of equation (2) by the core, from the weights of a structure."""

from collections.abc import Sequence

import numpy as np

from piezo_model.core import bindings
from piezo_model.dynamics import Dynamics
from piezo_model.inverse import invert_superposition
from piezo_model.operator_state import OperatorState, operator_arrays, pad
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector
from solvers.core import padded

Arrays = tuple[Vector | float, ...]
"""The first arguments of the core's ``model_simulate``."""


def split(s: ModelStructure, weights: Vector) -> Sequence[Vector]:
    """w_H (n + 1,), w'_S, w_K and the offset (1,) in the order of the core's compensator."""
    return np.split(weights, np.cumsum([s.n + 1, s.dead_zones, s.creep_weights]))


def all_weights(s: ModelStructure, w: Vector) -> Vector:
    """All weights of the unknowns w (d,) of the identification, with w_H0 = 1."""
    return np.concatenate([[1.0], w, [0.0] * (not s.offset)])


def arrays_of(s: ModelStructure, weights: Vector) -> Arrays:
    """Parameters of the core from all weights; those of S are inverted."""
    w_H, w_S_inverse, w_K, offset = split(s, weights)
    w_S, r_S = invert_superposition(w_S_inverse, np.array(s.dead_zone_thresholds))
    creeps = np.tile(pad(w_K, s.lanes), len(s.creep_rates))  # for every state, rate by rate
    padded_weights = pad(w_S, padded(w_S.size)), pad(w_H, s.lanes), creeps
    return *operator_arrays(s, r_S).values(), *padded_weights, float(offset[0])


def advance(s: ModelStructure, arrays: Arrays, x: Vector, state: OperatorState) -> tuple[Vector, OperatorState]:
    """Output (N,) for an input (N,), in the structure's units, and the states after it; ``state`` is not changed."""
    state, unit_x = state.copy(), s.unit_input(x)
    y = np.empty_like(unit_x)
    bindings.model_simulate(*arrays, state.play, state.creep, unit_x, y)
    return s.y_centre + s.y_scale * y, state


def behind_amplifier(s: ModelStructure, dynamics: Dynamics | None, x: Vector, state: OperatorState) -> Vector:
    """The input (N,) of the actuator behind the amplifier, which was in equilibrium at the initial states."""
    return (
        x if dynamics is None else dynamics.amplified(x, s.sample_time, s.x_centre + s.x_scale * float(state.play[0]))
    )


def before_dynamics(
    s: ModelStructure, arrays: Arrays, dynamics: Dynamics | None, x: Vector, state: OperatorState
) -> Vector:
    """Output (N,) before the dynamics for an input (N,), in the structure's units."""
    return advance(s, arrays, behind_amplifier(s, dynamics, x, state), state)[0]


def behind_dynamics(
    s: ModelStructure, arrays: Arrays, dynamics: Dynamics | None, static: Vector, state: OperatorState
) -> Vector:
    """Output (N,) behind the dynamics, for the output before them, from equilibrium at the initial states."""
    if dynamics is None:
        return static
    (balance,), _ = advance(s, arrays, np.array([s.x_centre + s.x_scale * state.play[0]]), state)
    return dynamics.filter(static, s.sample_time, float(balance))


def respond(s: ModelStructure, arrays: Arrays, dynamics: Dynamics | None, x: Vector, state: OperatorState) -> Vector:
    """Output (N,) of a model for an input (N,), in the structure's units."""
    return behind_dynamics(s, arrays, dynamics, before_dynamics(s, arrays, dynamics, x, state), state)
