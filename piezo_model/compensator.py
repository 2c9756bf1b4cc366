"""The compensator: the analytic inverse (8) of the model, one drive sample for each reference sample, and integral
action beside it.

If the model has dynamics, the reference passes their causal inverse first (`prefilter`), so that the stage does not
ring; the output then lags the reference by :attr:`Compensator.lag_s`. Integral action works on the difference between
the output and the reference model, and is added to the reference before the inverse.

Its state consists of the operator states of the *model*, H and K, advanced by the drive after saturation and rate
limit, which the actuator receives. For any reference, NaN and infinity included, the drive is finite and inside its
limits.
"""

import math
from collections.abc import Mapping
from typing import Any, NotRequired, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_model import checks, json_file
from piezo_model.core import State, Stateful, bindings
from piezo_model.json_file import LARGEST
from piezo_model.model import HysteresisCreepModel, ModelFile
from piezo_model.operator_state import OperatorState, write_operators
from piezo_model.prefilter import Prefilter
from piezo_model.structure import ModelStructure
from solvers.arrays import Matrix, Vector, reals

BUMP, LAST_Y_REF, CORRECTION, TARGET = range(4, 8)
"""Entries of the drive's memory (``DriveMemory`` in ``core/compensator.h``), behind its limits in the input unit and in
normalised units: the transfer bump, added to the drive since the last change of weights; the last finite reference; the
correction of integral action; and the target, which the output is compared with. Two follow that the core alone uses.
"""
DECAY = 5
"""Entry of the drive's settings (``DriveSettings``): the factor by which a transfer bump decays for each sample."""


class CompensatorState(TypedDict):
    """State of a compensator."""

    model: ModelFile
    play: np.ndarray
    creep: np.ndarray
    drive: np.ndarray
    decay: float
    prefilter: NotRequired[np.ndarray]
    """Constants and states of the dynamics."""


def blend_factor(s: ModelStructure, blend_time_s: float) -> float:
    """Factor by which a transfer bump decays for each sample; 0 for the time constant 0."""
    checks.not_negative(blend_time_s=blend_time_s)
    return math.exp(-s.sample_time / blend_time_s) if blend_time_s > 0.0 else 0.0


def drive_settings(s: ModelStructure, rate_limit: float | None, decay: float, integral_gain: float) -> Vector:
    """The core's ``DriveSettings`` (7,); ValueError if a setting is out of range."""
    if rate_limit is not None:
        checks.between(0.0, LARGEST, rate_limit=rate_limit)
    checks.require(
        lambda gain: 0.0 <= gain * s.sample_time <= 1.0,
        f"from 0 to 1/sample_time, {1.0 / s.sample_time:g} per second",
        integral_gain=integral_gain,
    )
    max_step = math.inf if rate_limit is None else float(rate_limit) * s.sample_time / s.x_scale
    return np.array([s.x_centre, s.x_scale, s.y_centre, s.y_scale, max_step, decay, integral_gain * s.sample_time])


def drive_memory(s: ModelStructure, low: ArrayLike, high: ArrayLike) -> Matrix:
    """The core's initial ``DriveMemory`` for these limits: (10,), or (10, count) for limits (count,)."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    memory = np.zeros((10, *low.shape))
    memory[:BUMP] = low, high, s.unit_input(low), s.unit_input(high)
    memory[LAST_Y_REF], memory[TARGET] = s.y_centre, math.nan
    return memory


class Compensator(Stateful):
    """Compensation of hysteresis and creep, open-loop or with integral action if a sensor stays in the loop.

    Parameters
    ----------
    model : HysteresisCreepModel
    x_limits : pair of float, optional
        Limits of the drive in the input unit, infinite for none; the model's range by default.
    rate_limit : float, optional
        Largest change of the drive in input units per second, from the first sample on; none by default.
    state : OperatorState, optional
        States of the operators before the first sample, copied, such as ``model.initial_state("recording")``; by
        default those of a stage that has settled at ``x_start``.
    x_start : float, optional
        Where the stage is before the first sample, in the input unit; by default at rest, which is 0 or the limit next
        to it.
    integral_gain : float
        Gain of the integral action on the outputs passed to ``correct``, in 1/s, from 0 (off) to 1/sample_time: the
        bandwidth in rad/s in which disturbances are suppressed.
    dynamics : bool
        Whether the dynamics of the model are inverted, too. A gain of the integral action with which the loop would be
        unstable beside them is refused: without the inverse it is about 2 ζ ω of a resonance.

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
        x_start: float | None = None,
        integral_gain: float = 0.0,
        dynamics: bool = True,
    ) -> None:
        checks.instance(HysteresisCreepModel, model=model)
        checks.flags(0, dynamics=dynamics)
        self._inverts, self._model = bool(dynamics), model
        s = model.structure
        x_limits = s.x_range if x_limits is None else x_limits
        checks.require(lambda pair: pair[0] < pair[1], "two numbers in ascending order", x_limits=x_limits)
        self._x_limits = float(x_limits[0]), float(x_limits[1])
        self._rate_limit, self._integral_gain = rate_limit, integral_gain
        checks.check(
            state is None or x_start is None, "give either state or x_start: the states say where the drive starts"
        )
        state = OperatorState.before_drive(s, self._x_limits, x_start) if state is None else state
        self._use(model, state, drive_memory(s, *self._x_limits)[BUMP:], 0.0)

    def _use(
        self,
        model: HysteresisCreepModel,
        state: OperatorState,
        drive: Vector,
        decay: float,
        filtered: Vector | None = None,
    ) -> None:
        """Change to a model, states and the state of the drive, and of the dynamics where they do not begin in balance;
        ValueError if anything is wrong, and then nothing has changed."""
        if self._integral_gain > 0.0:
            model.require_stable(self._integral_gain, inverts=self._inverts)
        s = model.structure
        OperatorState.check_fits(state, s)
        prefilter = Prefilter(model.dynamics if self._inverts else None, s.sample_time)
        shape = *s.shape, prefilter.modes, prefilter.ring
        core = State(bindings.compensator_bytes(*shape), lambda block: bindings.compensator_setup(block, *shape))
        write_operators(core, s, s.dead_zone_thresholds)
        core["settings"][:] = drive_settings(s, self._rate_limit, decay, self._integral_gain)
        core["play"][:], core["creep"][:] = state.play, state.creep
        bindings.compensator_set_weights(core.block, model.all_weights)
        core["prefilter"][: prefilter.constants.size] = prefilter.constants
        bindings.compensator_balance(core.block)
        core["memory"][:] = drive_memory(s, *self._x_limits)
        core["memory"][BUMP:] = drive
        if filtered is not None:
            values = core["prefilter"]
            checks.check(
                filtered.shape == values.shape and np.all(np.abs(filtered) <= LARGEST),
                f"the state of the dynamics must be {values.size} numbers of at most {LARGEST:g} in size",
            )
            values[:] = prefilter.with_states(filtered)
        self._model, self.prefilter, self._core = model, prefilter, core

    @property
    def lag_s(self) -> float:
        """Time by which the output lags a slow reference, in s; 0 without dynamics or without their inverse."""
        return self._model.lag_s if self._inverts else 0.0

    @property
    def state(self) -> OperatorState:
        """States of the operators before the next sample, a copy; assign to begin from others, with dynamics in
        balance."""
        return OperatorState(self._core["play"].copy(), self._core["creep"].copy())

    @state.setter
    def state(self, state: OperatorState) -> None:
        OperatorState.check_fits(state, self._model.structure)
        self._core["play"][:], self._core["creep"][:] = state.play, state.creep
        bindings.compensator_balance(self._core.block)

    @property
    def drive(self) -> Vector:
        """The core's ``DriveMemory`` (10,), a writable view."""
        return self._core["memory"]

    @property
    def block(self) -> NDArray[np.uint8]:
        """The state of the core; :meth:`change_model` and :meth:`restore` replace it."""
        return self._core.block

    def set_blend_time(self, blend_time_s: float) -> None:
        """Set the time constant with which the transfer bump of a hand-over decays."""
        self._core["settings"][DECAY] = blend_factor(self._model.structure, blend_time_s)

    @property
    def model(self) -> HysteresisCreepModel:
        """The model in use."""
        core, s = self._core, self._model.structure
        weights = np.concatenate(
            [core["w_H"][: s.n + 1], core["w_S"][: s.dead_zones], core["w_K"][: s.creep_weights], core["offset"]]
        )
        if not np.array_equal(self._model.all_weights, weights):  # a learner may have changed the weights
            self._model = HysteresisCreepModel.from_all_weights(s, weights).with_dynamics_of(self._model)
        return self._model

    def correct(self, y_measured: float) -> None:
        """Integral action on the output (output unit) that the last drive produced; NaN is ignored."""
        bindings.compensator_correct(self._core.block, y_measured)

    def step(self, y_ref: float) -> float:
        """Drive sample (input unit) for a reference sample (output unit)."""
        return float(bindings.compensator_step(self._core.block, y_ref))

    def run(self, y_ref: ArrayLike) -> Vector:
        """Drive samples (N,) for reference samples (N,), to the last bit those of ``step``."""
        (y_ref,) = checks.vectors(y_ref=y_ref)
        x = np.empty_like(y_ref)
        bindings.compensator_run(self._core.block, y_ref, x)
        return x

    def change_model(self, model: HysteresisCreepModel, blend_time_s: float = 0.0) -> None:
        """Change to another model of the same operators without a transfer bump.

        The states are kept. The change of the drive at this moment is subtracted from it and decays with the time
        constant ``blend_time_s``; with 0 the drive jumps. The new structure may have other ranges; the states are
        then converted by ``OperatorState.rescaled_to``. The inverse of other dynamics begins in balance.
        """
        checks.instance(HysteresisCreepModel, model=model)
        old, new = self._model.structure, model.structure
        for name in ("play_thresholds", "creep_rates", "sample_time"):
            checks.check(
                getattr(old, name) == getattr(new, name),
                f"the new model has other {name}, so the states of the actuator do not fit it",
            )
        before, state = bindings.compensator_now(self._core.block), self.state
        drive = self.drive[BUMP:].copy()
        if (old.x_centre, old.x_scale) != (new.x_centre, new.x_scale):
            state = state.rescaled_to(old, new)
            before = (old.x_centre + old.x_scale * before - new.x_centre) / new.x_scale
            drive[0] *= old.x_scale / new.x_scale
        goes_on = model.dynamics == self._model.dynamics
        filtered = self.prefilter.rescaled(self._core["prefilter"], old, new) if goes_on else None
        self._use(model, state, drive, blend_factor(new, blend_time_s), filtered)
        self.drive[BUMP] = drive[0] + before - bindings.compensator_now(self._core.block) if blend_time_s > 0.0 else 0.0

    def get_state(self) -> dict[str, Any]:
        """A copy of the whole state, including the model."""
        return {
            "model": self.model.to_dict(),
            "play": self.state.play,
            "creep": self.state.creep,
            "drive": self.drive[BUMP:].copy(),
            "decay": float(self._core["settings"][DECAY]),
            **({"prefilter": self._core["prefilter"].copy()} if self.prefilter.ring else {}),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue, to the last bit, from :meth:`get_state`; ValueError names what is wrong."""
        saved = json_file.convert(state, CompensatorState)
        model, drive = HysteresisCreepModel.from_file(saved["model"]), reals("drive", saved["drive"])
        # the last reference is NaN before the first one
        checks.check(
            drive.shape == (6,) and np.all(np.isfinite(drive[[0, 1, 2, 4, 5]])),
            "the state of the drive must be six finite numbers, but for the last reference",
        )
        checks.require(lambda decay: 0.0 <= decay <= 1.0, "from 0 to 1", decay=saved["decay"])
        operators = OperatorState(saved["play"], saved["creep"])
        self._use(model, operators, drive, saved["decay"], reals("prefilter", saved.get("prefilter", [])))
