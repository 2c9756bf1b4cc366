"""The compensator: the analytic inverse (8) of the model, one drive sample for each reference sample.

    x(k) = H⁻¹[ S⁻¹[y_r](k) − K(k) − offset ](k)

The creep part K(k) was advanced with x(k−1) already, so the implicit equation (8) is explicit. The compensator keeps
the states of the *model*, H and K, and derives those of H⁻¹ from them at every sample (`inverse`): what it returns
after saturation and rate limits is what the actuator really sees, and that is what moves the states on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_model.model import HysteresisCreepModel, ModelArrays, advance, creep_sum, superposition
from piezo_model.operator_state import OperatorState
from piezo_model.operators import play_step
from solvers.compiled import inlined, kernel

Vector = NDArray[np.float64]


@inlined
def inverse_hysteresis(model: ModelArrays, u: float, play: Vector) -> float:
    """H⁻¹[u] at this sample, from the states of H after the last one; nothing is moved on."""
    x = model.w_H_inverse[0] * u
    outside = 0.0
    for i in range(play.size - 1, 0, -1):  # padding has no weight and adds nothing
        state = model.W_H[i] * play[i] + outside
        outside += model.w_H[i] * play[i]
        x += model.w_H_inverse[i] * play_step(u, model.r_H_inverse[i], state)
    return x


FARTHEST = 1e6
"""References beyond so many half ranges are taken for this, so that no sum overflows."""


@inlined
def compensate_step(model: ModelArrays, y_ref: float, play: Vector, creep: Vector, limits: Vector) -> float:
    """Drive sample for one reference sample, within limits, all in unit amplitudes; moves the states on.

    ``limits`` holds lowest and highest drive, largest change, the bump of the last change of model and the factor by which
    it decays. A reference that is not finite holds the drive where it is.
    """
    last = play[0]
    x = last
    if math.isfinite(y_ref):
        y_ref = max(-FARTHEST, min(FARTHEST, y_ref))
        u = superposition(y_ref, model.S_inverse) - creep_sum(model, creep) - model.offset
        x = inverse_hysteresis(model, u, play) + limits[BUMP]
        limits[BUMP] *= limits[DECAY]
        x = max(last - limits[MAX_STEP], min(last + limits[MAX_STEP], x))
    x = max(limits[LOW], min(limits[HIGH], x))
    advance(model.operators, x, play, creep)
    return x


@kernel
def _run(model: ModelArrays, y_ref: Vector, play: Vector, creep: Vector, limits: Vector, x: Vector) -> None:
    for k in range(y_ref.size):
        x[k] = compensate_step(model, y_ref[k], play, creep, limits)


@kernel
def _drive_now(model: ModelArrays, y_ref: float, play: Vector, creep: Vector) -> float:
    """What the model would drive for this reference at this moment; nothing is moved on."""
    u = superposition(y_ref, model.S_inverse) - creep_sum(model, creep) - model.offset
    return inverse_hysteresis(model, u, play)


LOW, HIGH, MAX_STEP, BUMP, DECAY = range(5)


class Compensator:
    """Open-loop compensation of hysteresis and creep.

    Parameters
    ----------
    model : HysteresisCreepModel
    x_limits : pair of float, optional
        Limits of the drive in the input unit; none by default.
    rate_limit : float, optional
        Largest change of the drive in input units per second; none by default.
    state : OperatorState, optional
        What the actuator has seen so far; at rest at the centre of the range by default. Taken as a copy.

    Examples
    --------
    >>> import numpy as np
    >>> from piezo_model.structure import ModelStructure
    >>> structure = ModelStructure.equidistant(n=1, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(),
    ...                                        sample_time=1e-3)
    >>> model = HysteresisCreepModel.from_weights(structure, [1.0, 2.0])
    >>> y_ref = np.array([0.0, 0.5, 0.2, -0.3])
    >>> x = Compensator(model).run(y_ref)
    >>> bool(np.allclose(model.simulate(x), y_ref, atol=1e-15))
    True
    """

    def __init__(self, model: HysteresisCreepModel, x_limits: tuple[float, float] | None = None,
                 rate_limit: float | None = None, state: OperatorState | None = None) -> None:
        s = model.structure
        low, high = (-math.inf, math.inf) if x_limits is None else x_limits
        if not low < high:
            raise ValueError(f"x_limits must be two numbers in ascending order, not {x_limits}")
        if rate_limit is not None and not rate_limit > 0.0:
            raise ValueError(f"rate_limit must be positive, not {rate_limit}")
        self.model = model
        self.state = OperatorState.at_rest(s) if state is None else state.copy()
        self.state.require(s)
        max_step = math.inf if rate_limit is None else rate_limit * s.sample_time / s.x_scale
        self._limits = np.array([(low - s.x_centre) / s.x_scale, (high - s.x_centre) / s.x_scale, max_step, 0.0, 0.0])
        self._x_limits = (low, high)
        self._last_y_ref = 0.0

    def step(self, y_ref: float) -> float:
        """Drive sample (input unit) that brings the actuator to the reference sample (output unit)."""
        return float(self.run(np.array([y_ref]))[0])

    def run(self, y_ref: ArrayLike) -> Vector:
        """Drive samples (N,) for reference samples (N,); the same as ``step`` one by one."""
        s = self.model.structure
        unit_y = s.unit_output(np.ascontiguousarray(y_ref, dtype=np.float64))
        x = np.empty_like(unit_y)
        _run(self.model.arrays, unit_y, self.state.play, self.state.creep, self._limits, x)
        if unit_y.size and math.isfinite(unit_y[-1]):
            self._last_y_ref = float(unit_y[-1])
        return np.clip(s.x_centre + s.x_scale * x, *self._x_limits)  # rounding may pass a limit by its last bit

    def change_model(self, model: HysteresisCreepModel, fade_s: float = 0.0) -> None:
        """Go on with another model of the same structure, without a bump.

        The states are those of the actuator and stay. What the new model would drive differently at this very moment is
        added to its drive and decays with the time constant ``fade_s``; with 0 the drive jumps.
        """
        if model.structure != self.model.structure:
            raise ValueError("the new model has another structure, so the states of the actuator do not fit it")
        bump = 0.0
        if fade_s > 0.0:
            y_ref, play, creep = self._last_y_ref, self.state.play, self.state.creep
            bump = _drive_now(self.model.arrays, y_ref, play, creep) - _drive_now(model.arrays, y_ref, play, creep)
            self._limits[DECAY] = math.exp(-model.structure.sample_time / fade_s)
        self._limits[BUMP] = self._limits[BUMP] + bump if fade_s > 0.0 else 0.0
        self.model = model

    def memory(self) -> dict[str, Any]:
        """Everything that changes while it runs, as JSON can hold it; floats survive bit for bit."""
        return {"play": self.state.play.tolist(), "creep": self.state.creep.tolist(), "bump": float(self._limits[BUMP]),
                "decay": float(self._limits[DECAY]), "last_y_ref": self._last_y_ref}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on from what :meth:`memory` gave."""
        state = OperatorState(np.array(memory["play"]), np.array(memory["creep"]))
        state.require(self.model.structure)
        self.state = state
        self._limits[BUMP], self._limits[DECAY] = memory["bump"], memory["decay"]
        self._last_y_ref = float(memory["last_y_ref"])
