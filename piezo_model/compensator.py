"""The compensator: the analytic inverse (8) of the model, one drive sample for each reference sample, and integral
action beside it.

The compensator keeps the states of the *model*, H and K: what it returns after saturation and rate limits is
what the actuator really sees, and that is what moves the states on. Whatever the reference is, NaN and infinity
included, the drive is finite and inside its limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_model import json_file
from piezo_model.core import State, bindings
from piezo_model.model import HysteresisCreepModel, ModelFile
from piezo_model.operator_state import OperatorState, write_operators
from piezo_model.structure import ModelStructure
from solvers.arrays import Matrix, Vector

LIMITS = slice(0, 4)
"""Entries of the drive's memory (``DriveMemory`` in ``core/compensator.h``): its limits, in the input unit and in unit
amplitudes."""
BUMP, LAST_Y_REF, CORRECTION, GIVEN, HELD, TURN = range(4, 10)
"""Its other entries: what is still added to the drive since the last change of weights; the last finite reference and
what integral action has added to it; the last reference as it was given, and 1 or -1 where the limits held the drive
for it; which creep states are looked through next."""
DECAY = 5
"""Entry of the drive's settings (``DriveSettings``): the factor by which a bump decays a sample."""


def integral_share(gain: float, sample_time: float) -> float:
    """Share of an error that integral action adds up a sample, of its gain in 1/s; ValueError where it is not between 0
    and 1."""
    if not 0.0 <= gain * sample_time <= 1.0:
        raise ValueError(f"integral_gain must be from 0 to 1/sample_time, {1.0 / sample_time:g} per second, not {gain}")
    return gain * sample_time


class CompensatorMemory(TypedDict):
    """What changes while a compensator runs."""

    model: ModelFile
    play: np.ndarray
    creep: np.ndarray
    drive: np.ndarray
    decay: float


def fade_factor(s: ModelStructure, fade_s: float) -> float:
    """Factor by which a bump decays a sample, of its time constant; with 0 it is not there at all."""
    return math.exp(-s.sample_time / fade_s) if fade_s > 0.0 else 0.0


def drive_settings(s: ModelStructure, rate_limit: float | None, decay: float, integral_gain: float) -> Vector:
    """The settings (7,) of the core's ``DriveSettings``; ValueError where they make no sense."""
    if rate_limit is not None and not rate_limit > 0.0:
        raise ValueError(f"rate_limit must be positive, not {rate_limit}")
    max_step = math.inf if rate_limit is None else float(rate_limit) * s.sample_time / s.x_scale
    share = integral_share(integral_gain, s.sample_time)
    return np.array([s.x_centre, s.x_scale, s.y_centre, s.y_scale, max_step, decay, share])


def drive_memory(s: ModelStructure, low: ArrayLike, high: ArrayLike) -> Matrix:
    """The core's ``DriveMemory`` of a drive that begins, inside these limits: (10,), or (10, count) where these are
    arrays (count,)."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    memory = np.zeros((10, *low.shape))
    memory[LIMITS] = low, high, s.unit_input(low), s.unit_input(high)
    memory[LAST_Y_REF], memory[GIVEN] = s.y_centre, math.nan
    return memory


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
        Of the integral action on what ``correct`` is told, in 1/s, from 0, none, to 1/sample_time: the bandwidth in
        rad/s in which disturbances are suppressed.

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

    def __init__(
        self,
        model: HysteresisCreepModel,
        x_limits: tuple[float, float] | None = None,
        rate_limit: float | None = None,
        state: OperatorState | None = None,
        *,
        integral_gain: float = 0.0,
    ) -> None:
        s = model.structure
        low, high = (-math.inf, math.inf) if x_limits is None else (float(x_limits[0]), float(x_limits[1]))
        if not low < high:
            raise ValueError(f"x_limits must be two numbers in ascending order, not {(low, high)}")
        self._x_limits, self._rate_limit, self._integral_gain = (low, high), rate_limit, integral_gain
        state = OperatorState.at_rest(s) if state is None else state
        state.require(s)
        self._use(model, state, drive_memory(s, low, high)[BUMP:], 0.0)

    def _use(self, model: HysteresisCreepModel, state: OperatorState, drive: Vector, decay: float) -> None:
        s, self._model = model.structure, model
        self._core = State(
            bindings.compensator_bytes(*s.shape), lambda block: bindings.compensator_setup(block, *s.shape)
        )
        write_operators(self._core, s, s.dead_zone_thresholds)
        self._core["settings"][:] = drive_settings(s, self._rate_limit, decay, self._integral_gain)
        self._core["play"][:], self._core["creep"][:] = state.play, state.creep
        self.drive[:] = drive_memory(s, *self._x_limits)
        self.drive[BUMP:] = drive
        bindings.compensator_set_weights(self._core.block, model.all_weights)

    @property
    def state(self) -> OperatorState:
        """The operators' states before the coming sample; what is written to its arrays is taken."""
        return OperatorState(self._core["play"], self._core["creep"])

    @state.setter
    def state(self, state: OperatorState) -> None:
        state.require(self._model.structure)
        self._core["play"][:], self._core["creep"][:] = state.play, state.creep

    @property
    def drive(self) -> Vector:
        """The drive's memory (10,); what is written to it is taken."""
        return self._core["memory"]

    @property
    def block(self) -> NDArray[np.uint8]:
        """The state of the core; another one after :meth:`change_model` and :meth:`restore`."""
        return self._core.block

    def fade_over(self, fade_s: float) -> None:
        """Let what a hand-over of weights adds to the drive decay with the time constant ``fade_s``."""
        self._core["settings"][DECAY] = fade_factor(self._model.structure, fade_s)

    @property
    def model(self) -> HysteresisCreepModel:
        """The model in use."""
        core, s = self._core, self._model.structure
        weights = np.concatenate(
            [core["w_H"][: s.n + 1], core["w_S"][: s.dead_zones], core["w_K"][: s.creep_weights], core["offset"]]
        )
        if not np.array_equal(self._model.all_weights, weights):  # the learner handed weights over
            self._model = HysteresisCreepModel.from_all_weights(s, weights)
        return self._model

    def correct(self, y_measured: float) -> None:
        """Take the output (output unit) that the last drive produced, for the integral action; NaN is left out."""
        bindings.compensator_correct(self._core.block, y_measured)

    def step(self, y_ref: float) -> float:
        """Drive sample (input unit) that brings the actuator to the reference sample (output unit)."""
        return float(bindings.compensator_step(self._core.block, y_ref))

    def run(self, y_ref: ArrayLike) -> Vector:
        """Drive samples (N,) for reference samples (N,); the same, to the last bit, as ``step`` one by one."""
        y_ref = np.ascontiguousarray(y_ref, dtype=np.float64)
        x = np.empty_like(y_ref)
        bindings.compensator_run(self._core.block, y_ref, x)
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
        before, state = bindings.compensator_now(self._core.block), self.state
        drive = self.drive[BUMP:].copy()
        if (old.x_centre, old.x_scale) != (new.x_centre, new.x_scale):
            state = state.on(old, new)
            before = (old.x_centre + old.x_scale * before - new.x_centre) / new.x_scale
            drive[0] *= old.x_scale / new.x_scale
        self._use(model, state, drive, fade_factor(new, fade_s))
        self.drive[BUMP] = drive[0] + before - bindings.compensator_now(self._core.block) if fade_s > 0.0 else 0.0

    def memory(self) -> dict[str, Any]:
        """Everything that changes while it runs: the model, and copies of the arrays."""
        return {
            "model": self.model.to_dict(),
            "play": self.state.play.copy(),
            "creep": self.state.creep.copy(),
            "drive": self.drive[BUMP:].copy(),
            "decay": float(self._core["settings"][DECAY]),
        }

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on, to the last bit, from what :meth:`memory` gave; ValueError says why not."""
        found = json_file.convert(memory, CompensatorMemory)
        model, state, drive = (
            HysteresisCreepModel.from_file(found["model"]),
            OperatorState(found["play"], found["creep"]),
            found["drive"],
        )
        state.require(model.structure)
        # the last reference may have been none
        if drive.shape != (6,) or not np.all(np.isfinite(drive[[0, 1, 2, 4, 5]])):
            raise ValueError("the memory of the drive must be six finite numbers, but for the last reference")
        if not (np.all(np.isfinite(state.play)) and np.all(np.isfinite(state.creep)) and 0.0 <= found["decay"] < 1.0):
            raise ValueError("the states of the operators must be finite, and the decay at least 0 and below 1")
        self._use(model, state, drive, found["decay"])
