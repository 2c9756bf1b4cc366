"""The compensator: the analytic inverse (8) of the model, one drive sample for each reference sample.

The compensator keeps the states of the *model*, H and K (`inverse_model`): what it returns after saturation and rate limits is
what the actuator really sees, and that is what moves the states on. Whatever the reference is, NaN and infinity
included, the drive is finite and inside its limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_model.inverse_model import InverseArrays, all_weights, model_of, set_weights, wanted_drive
from piezo_model.model import HysteresisCreepModel, advance
from piezo_model.operator_state import OperatorState
from piezo_model.structure import ModelStructure
from solvers.compiled import inlined, kernel

Vector = NDArray[np.float64]

FARTHEST = 1e6
"""References beyond so many half ranges are taken for this, so that no sum overflows."""

BUMP, DECAY, LAST_Y_REF = range(3)
"""Entries of the fade memory: what is still added to the drive since the last change of model, the factor by which it
decays from sample to sample, and the last finite reference in the output unit."""


class DriveLimits(NamedTuple):
    """Centres and scales of the structure, limits of the drive in the input unit and, with its largest change, unit amplitudes."""

    x_centre: float
    x_scale: float
    y_centre: float
    y_scale: float
    low: float
    high: float
    unit_low: float
    unit_high: float
    max_step: float

    @classmethod
    def of(cls, s: ModelStructure, x_limits: tuple[float, float] | None, rate_limit: float | None) -> DriveLimits:
        """Limits of a structure; ValueError where they make no sense."""
        low, high = (-math.inf, math.inf) if x_limits is None else (float(x_limits[0]), float(x_limits[1]))
        if not low < high:
            raise ValueError(f"x_limits must be two numbers in ascending order, not {(low, high)}")
        if rate_limit is not None and not rate_limit > 0.0:
            raise ValueError(f"rate_limit must be positive, not {rate_limit}")
        max_step = math.inf if rate_limit is None else float(rate_limit) * s.sample_time / s.x_scale
        return cls(s.x_centre, s.x_scale, s.y_centre, s.y_scale, low, high, (low - s.x_centre) / s.x_scale,
                   (high - s.x_centre) / s.x_scale, max_step)


@inlined
def unit_reference(p: DriveLimits, y_ref: float) -> float:
    """A finite reference in unit amplitudes, far-away ones brought near."""
    return max(-FARTHEST, min(FARTHEST, (y_ref - p.y_centre) / p.y_scale))


@inlined
def within_limits(p: DriveLimits, x: float) -> float:
    """Unit drive inside the limits."""
    return max(p.unit_low, min(p.unit_high, x))


@inlined
def drive_step(p: InverseArrays, limits: DriveLimits, y_ref: float, play: Vector, creep: Vector, fade: Vector) -> float:
    """Drive sample in the input unit for one reference sample in the output unit; moves the states on.

    A reference that is not finite holds the drive where it is.
    """
    last = play[0]
    x = last
    if math.isfinite(y_ref):
        fade[LAST_Y_REF] = y_ref
        x = wanted_drive(p, unit_reference(limits, y_ref), play, creep) + fade[BUMP]
        fade[BUMP] *= fade[DECAY]
        x = max(last - limits.max_step, min(last + limits.max_step, x))
    x = limits.x_centre + limits.x_scale * within_limits(limits, x)
    x = max(limits.low, min(limits.high, x))  # rounding may have passed a limit by its last bit
    advance(p.operators, (x - limits.x_centre) / limits.x_scale, play, creep)
    return x


@inlined
def hand_over_step(p: InverseArrays, limits: DriveLimits, weights: Vector, play: Vector, creep: Vector,
                   fade: Vector) -> None:
    """Take new weights over without a bump: what they would drive differently at this moment is added and fades away."""
    y_ref = unit_reference(limits, fade[LAST_Y_REF])
    before = within_limits(limits, wanted_drive(p, y_ref, play, creep))
    set_weights(p, weights)
    fade[BUMP] += before - within_limits(limits, wanted_drive(p, y_ref, play, creep))


@kernel
def _run(p: InverseArrays, limits: DriveLimits, y_ref: Vector, play: Vector, creep: Vector, fade: Vector, x: Vector) -> None:
    for k in range(y_ref.size):
        x[k] = drive_step(p, limits, y_ref[k], play, creep, fade)


@kernel
def _drive_now(p: InverseArrays, limits: DriveLimits, play: Vector, creep: Vector, fade: Vector) -> float:
    """What the model would drive for the last reference at this moment; nothing is moved on."""
    return within_limits(limits, wanted_drive(p, unit_reference(limits, fade[LAST_Y_REF]), play, creep))


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
        self._x_limits, self._rate_limit = x_limits, rate_limit
        self.state = OperatorState.at_rest(s) if state is None else state.copy()
        self.state.require(s)
        self.fade = np.array([0.0, 0.0, s.y_centre])
        self._use(model)

    def _use(self, model: HysteresisCreepModel) -> None:
        self._model, self.limits = model, DriveLimits.of(model.structure, self._x_limits, self._rate_limit)
        self.inverse = InverseArrays.of(model.structure)
        set_weights(self.inverse, all_weights(model))

    @property
    def model(self) -> HysteresisCreepModel:
        """The model in use."""
        if not np.array_equal(all_weights(self._model), self.inverse.weights):  # compiled code handed weights over
            self._model = model_of(self._model.structure, self.inverse.weights)
        return self._model

    def step(self, y_ref: float) -> float:
        """Drive sample (input unit) that brings the actuator to the reference sample (output unit)."""
        return float(self.run(np.array([y_ref], dtype=np.float64))[0])

    def run(self, y_ref: ArrayLike) -> Vector:
        """Drive samples (N,) for reference samples (N,); the same, to the last bit, as ``step`` one by one."""
        y_ref = np.ascontiguousarray(y_ref, dtype=np.float64)
        x = np.empty_like(y_ref)
        _run(self.inverse, self.limits, y_ref, self.state.play, self.state.creep, self.fade, x)
        return x

    def change_model(self, model: HysteresisCreepModel, fade_s: float = 0.0) -> None:
        """Go on with another model of the same operators, without a bump.

        The states are those of the actuator and stay. What the new model would drive differently at this very moment is
        added to its drive and decays with the time constant ``fade_s``; with 0 the drive jumps. The new structure may
        have other ranges; the states are carried over to other thresholds of the drive as of ``OperatorState.on``.
        """
        old, new = self._model.structure, model.structure
        for name in ("play_thresholds", "creep_rates", "sample_time"):
            if getattr(old, name) != getattr(new, name):
                raise ValueError(f"the new model has other {name}, so the states of the actuator do not fit it")
        before = _drive_now(self.inverse, self.limits, self.state.play, self.state.creep, self.fade)
        if (old.x_centre, old.x_scale) != (new.x_centre, new.x_scale):
            self.state = self.state.on(old, new)
            before = (old.x_centre + old.x_scale * before - new.x_centre) / new.x_scale
            self.fade[BUMP] *= old.x_scale / new.x_scale
        self._use(model)
        bump = before - _drive_now(self.inverse, self.limits, self.state.play, self.state.creep, self.fade)
        self.fade[BUMP] = self.fade[BUMP] + bump if fade_s > 0.0 else 0.0
        self.fade[DECAY] = math.exp(-new.sample_time / fade_s) if fade_s > 0.0 else 0.0

    def memory(self) -> dict[str, Any]:
        """Everything that changes while it runs: the model, and copies of the arrays."""
        return {"model": self.model.to_dict(), "play": self.state.play.copy(), "creep": self.state.creep.copy(),
                "fade": self.fade.copy()}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on, to the last bit, from what :meth:`memory` gave; ModelError or ValueError says why not."""
        model = HysteresisCreepModel.from_dict(memory["model"])
        state = OperatorState(memory["play"], memory["creep"]).copy()
        state.require(model.structure)
        if memory["fade"].shape != self.fade.shape:
            raise ValueError(f"the fade memory must have {self.fade.size} numbers, not {memory['fade'].size}")
        self._use(model)
        self.state, self.fade = state, memory["fade"].copy()
