"""The compensator: the analytic inverse (8) of the model, one drive sample for each reference sample, and integral action beside it.

The compensator keeps the states of the *model*, H and K: what it returns after saturation and rate limits is
what the actuator really sees, and that is what moves the states on. Whatever the reference is, NaN and infinity
included, the drive is finite and inside its limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_model import json_file
from piezo_model.core import State, face
from piezo_model.model import HysteresisCreepModel, ModelFile
from piezo_model.operator_state import OperatorArrays, OperatorState, SuperpositionArrays
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

BUMP, DECAY = range(2)
"""Entries of the fade memory: what is still added to the drive since the last change of model, the factor by which it
decays from sample to sample; the third is the last finite reference in the output unit."""
CORRECTION = 1
"""Entry of the feedback memory (``Feedback`` in ``core/compensator.h``): what integral action has added to the reference so far."""


def integral_share(gain: float, sample_time: float) -> float:
    """Share of an error that integral action adds up a sample, of its gain in 1/s; ValueError where it is not between 0 and 1."""
    if not 0.0 <= gain * sample_time <= 1.0:
        raise ValueError(f"integral_gain must be from 0 to 1/sample_time, {1.0 / sample_time:g} per second, not {gain}")
    return gain * sample_time


class CompensatorMemory(TypedDict):
    """What changes while a compensator runs."""

    model: ModelFile
    play: np.ndarray
    creep: np.ndarray
    fade: np.ndarray
    feedback: np.ndarray


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


class Compensator:
    """Compensation of hysteresis and creep, open-loop or with integral action where a sensor stays in the loop.

    Parameters
    ----------
    model : HysteresisCreepModel
    x_limits : pair of float, optional
        Limits of the drive in the input unit; none by default.
    rate_limit : float, optional
        Largest change of the drive in input units per second; none by default.
    state : OperatorState, optional
        What the actuator has seen so far; at rest at the centre of the range by default. Taken as a copy.
    integral_gain : float
        Of the integral action on what ``correct`` is told, in 1/s, from 0, none, to 1/sample_time: the bandwidth in rad/s in which
        disturbances are suppressed.

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
                 rate_limit: float | None = None, state: OperatorState | None = None, *, integral_gain: float = 0.0) -> None:
        s = model.structure
        self._x_limits, self._rate_limit = x_limits, rate_limit
        state = OperatorState.at_rest(s) if state is None else state
        state.require(s)
        self._use(model, state, np.array([0.0, 0.0, s.y_centre]), np.array([integral_share(integral_gain, s.sample_time), 0.0, math.nan, 0.0]))

    def _use(self, model: HysteresisCreepModel, state: OperatorState, fade: Vector, feedback: Vector) -> None:
        s, self._model = model.structure, model
        self.limits = DriveLimits.of(s, self._x_limits, self._rate_limit)
        zones, operators = SuperpositionArrays.of(model.w_S_inverse, np.array(s.dead_zone_thresholds)), OperatorArrays.of(s)
        self._core = State(face.compensator_bytes(*s.shape), lambda block: face.compensator_setup(block, *s.shape))
        for name, values in (("r", operators.r), ("a", operators.a), ("low", zones.low), ("high", zones.high),
                             ("limits", self.limits), ("play", state.play), ("creep", state.creep), ("fade", fade), ("feedback", feedback)):
            self._core[name][:] = values
        face.compensator_take(self._core.block, model.all_weights)

    @property
    def state(self) -> OperatorState:
        """The operators' states before the coming sample; what is written to its arrays is taken."""
        return OperatorState(self._core["play"], self._core["creep"])

    @state.setter
    def state(self, state: OperatorState) -> None:
        state.require(self._model.structure)
        self._core["play"][:], self._core["creep"][:] = state.play, state.creep

    @property
    def fade(self) -> Vector:
        """The fade memory (3,); what is written to it is taken."""
        return self._core["fade"]

    @fade.setter
    def fade(self, fade: Vector) -> None:
        self._core["fade"][:] = fade

    @property
    def block(self) -> NDArray[np.uint8]:
        """The state of the core; another one after :meth:`change_model` and :meth:`restore`."""
        return self._core.block

    def fade_over(self, fade_s: float) -> None:
        """Let what a hand-over of weights adds to the drive decay with the time constant ``fade_s``."""
        self.fade[DECAY] = math.exp(-self._model.structure.sample_time / fade_s)

    @property
    def feedback(self) -> Vector:
        """The feedback memory (4,); what is written to it is taken."""
        return self._core["feedback"]

    @property
    def model(self) -> HysteresisCreepModel:
        """The model in use."""
        if not np.array_equal(self._model.all_weights, self._core["weights"]):  # the learner handed weights over
            self._model = HysteresisCreepModel.from_all_weights(self._model.structure, self._core["weights"])
        return self._model

    def correct(self, y_measured: float) -> None:
        """Take the output (output unit) that the last drive produced, for the integral action; NaN is left out."""
        face.compensator_correct(self._core.block, y_measured)

    def step(self, y_ref: float) -> float:
        """Drive sample (input unit) that brings the actuator to the reference sample (output unit)."""
        return float(face.compensator_step(self._core.block, y_ref))

    def run(self, y_ref: ArrayLike) -> Vector:
        """Drive samples (N,) for reference samples (N,); the same, to the last bit, as ``step`` one by one."""
        y_ref = np.ascontiguousarray(y_ref, dtype=np.float64)
        x = np.empty_like(y_ref)
        face.compensator_run(self._core.block, y_ref, x)
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
        before, state = face.compensator_now(self._core.block), self.state
        if (old.x_centre, old.x_scale) != (new.x_centre, new.x_scale):
            state = state.on(old, new)
            before = (old.x_centre + old.x_scale * before - new.x_centre) / new.x_scale
            self.fade[BUMP] *= old.x_scale / new.x_scale
        self._use(model, state, self.fade, self.feedback)
        bump = before - face.compensator_now(self._core.block)
        self.fade[BUMP] = self.fade[BUMP] + bump if fade_s > 0.0 else 0.0
        self.fade[DECAY] = math.exp(-new.sample_time / fade_s) if fade_s > 0.0 else 0.0

    def memory(self) -> dict[str, Any]:
        """Everything that changes while it runs: the model, and copies of the arrays."""
        return {"model": self.model.to_dict(), "play": self.state.play.copy(), "creep": self.state.creep.copy(),
                "fade": self.fade.copy(), "feedback": self.feedback.copy()}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on, to the last bit, from what :meth:`memory` gave; ValueError says why not."""
        found = json_file.convert(memory, CompensatorMemory)
        model, state = HysteresisCreepModel.from_file(found["model"]), OperatorState(found["play"], found["creep"])
        state.require(model.structure)
        for name, values in (("fade", found["fade"]), ("feedback", found["feedback"])):
            if values.shape != self._core[name].shape:
                raise ValueError(f"the {name} memory must have {self._core[name].size} numbers, not {values.size}")
        self._use(model, state, found["fade"], found["feedback"])
