"""The inverse F of the dynamics and the reference model R = G F, sample by sample (`dynamics`).

F in direct form II has the states s with R_i(z)/R_i(1) s = input and output = D_i(z)/D_i(1) s. So s is the output
divided by D_i(z)/D_i(1): the modal displacement of the stage. If a limit held the drive, the stage had another input
than F put out, and the newest s is set from that, so that F goes on from where the stage is and not from where it
should be.
"""

from __future__ import annotations

import math

import numpy as np

from piezo_model.dynamics import Dynamics
from solvers.arrays import Vector


class Prefilter:
    """F, in balance at a level before the first sample."""

    def __init__(self, dynamics: Dynamics, sample_time: float, level: float) -> None:
        self._pairs = [(D.tolist(), R.tolist()) for D, R in dynamics.pole_pairs(sample_time)]
        self._modal = [[level] * 3 for _ in self._pairs]

    def step(self, y: float) -> float:
        """Output for the next sample."""
        for (D, R), s in zip(self._pairs, self._modal, strict=True):
            s[:] = (y - R[1] * s[0] - R[2] * s[1]) / R[0], s[0], s[1]
            y = D[0] * s[0] + D[1] * s[1] + D[2] * s[2]
        return y

    def follow(self, v: float) -> None:
        """Set the states for the last sample as if the output had been v."""
        for (D, R), s in zip(reversed(self._pairs), reversed(self._modal), strict=True):
            s[0] = (v - D[1] * s[1] - D[2] * s[2]) / D[0]
            v = R[0] * s[0] + R[1] * s[1] + R[2] * s[2]

    @property
    def state(self) -> Vector:
        """The states (3 · modes,)."""
        return np.array(self._modal).ravel()

    @state.setter
    def state(self, values: Vector) -> None:
        self._modal = values.reshape(-1, 3).tolist()


class ReferenceModel:
    """R with the lag of the amplifier, in balance at a level before the first sample."""

    def __init__(self, dynamics: Dynamics, sample_time: float, level: float) -> None:
        self._inverse, self._behind = Prefilter(dynamics, sample_time, level), level
        lag = dynamics.amplifier_lag_s
        self._decay = math.exp(-sample_time / lag) if lag else 0.0
        self._stream = dynamics.stream(sample_time, level)

    def step(self, y_ref: float) -> float:
        """Output that the stage should have for the next sample of a reference."""
        v = self._inverse.step(y_ref)
        self._behind = v + self._decay * (self._behind - v)
        return float(self._stream(np.array([self._behind]))[0])

    @property
    def state(self) -> Vector:
        """The states, in one vector."""
        return np.concatenate([self._inverse.state, [self._behind, self._stream.balance], *self._stream.states])

    @state.setter
    def state(self, values: Vector) -> None:
        own = self._inverse.state.size
        self._inverse.state, self._behind, self._stream.balance = values[:own], float(values[own]), values[own + 1]
        ends = np.cumsum([state.size for state in self._stream.states])[:-1]
        self._stream.states = [part.copy() for part in np.split(values[own + 2 :], ends)]
