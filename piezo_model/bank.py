"""Thousands of self-learning compensators of one structure: tiles of eight actuators, one in each lane of a vector
(``core/bank.h``).

Each actuator has its own weights, states, limits and sensor guard, and affects no bit of another one. The drive is that
of `Compensator`; learning is that of the continuous mode of `SelfLearningCompensator`, in the given ranges of the
structure.
"""

import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NotRequired, Self, TypedDict

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.atomic_file import replacing
from piezo_model.compensator import blend_factor, drive_memory, drive_settings
from piezo_model.core import State, Stateful, bindings
from piezo_model.dynamics import Dynamics
from piezo_model.json_file import LARGEST, Number, Versioned, convert, decoded, packed
from piezo_model.learning.layout import MEMORY, learner_numbers, write_settings
from piezo_model.learning.settings import LearningSettings
from piezo_model.model import HysteresisCreepModel, ModelError
from piezo_model.operator_state import OperatorState, drive_start
from piezo_model.prefilter import Prefilter
from piezo_model.regressors import write_slope_regressors
from piezo_model.structure import ModelStructure
from solvers.arrays import Index, Mask, Matrix, Vector, reals

LANES = 8
"""Actuators of a tile."""
GOLDEN = 0.6180339887498949
"""Tile t begins late by the fractional part of t times this number in intervals, which is evenly spread for any number
of tiles, and by t whole intervals, which spreads the checkpoints too."""
TABLES = ("driver", "learner", "checkpoint")
"""Parts of a tile, in the order of their addresses; each has the rows of all tiles one after the other."""
LANE_BY_LANE = (
    *("drive_memory", "play", "creep", "w_H", "w_S", "w_K", "offset", "prefilter"),
    *("noise_gains", "memory", "in_use", "candidate", "gram"),
)
"""Parts of these with a number for each of the tile's actuators."""
MOST_TILES = 2**24


class BankState(TypedDict):
    """State of a bank, without the settings."""

    core: np.ndarray
    slots: np.ndarray
    dynamics: NotRequired[np.ndarray]


class Options(TypedDict):
    """Settings of a bank."""

    forgetting_time_s: float
    hand_over_s: float
    reset_s: float
    blend_time_s: float
    integral_gain: float
    rate_limit: Number | None


class BankFile(Versioned):
    """The content of a file besides the arrays."""

    FORMAT = "piezobench-bank"
    VERSION = 6
    UPGRADE_HINT = "load it with the program that wrote it, and take its models over"
    structure: ModelStructure
    tiles: Annotated[int, Meta(ge=1, le=MOST_TILES)]
    options: Options
    dynamics: Dynamics | None = None


class CompensatorBank(Stateful):
    """Self-learning compensators of ``count`` actuators.

    Parameters
    ----------
    structure : ModelStructure
    count : int
    x_limits : pair of float or of arrays (count,), optional
        Limits of the drives in the input unit; the structure's range by default.
    learn : bool or array (count,)
        Which actuators learn; see :attr:`learning`.
    x_start : float or array (count,), optional
        Where the stages are before the first sample, as of ``Compensator``.
    forgetting_time_s, reset_s, blend_time_s, rate_limit, integral_gain
        As of ``SelfLearningCompensator``.
    hand_over_s : float
        Interval between exact optima of an actuator, rounded down to a multiple of equal blocks of at most 32 samples
        (:attr:`interval`).
    dynamics : Dynamics, optional
        Of every stage, until a model with others of as many modes and at most twice the lag is taken; none by default.
    threads : int
        Number of threads; the results are the same to the last bit.

    Examples
    --------
    >>> structure = ModelStructure.equidistant(n=5, m=3, x_range=(0, 150), y_range=(-20, 20), creep_rates=(10.0, 1.0),
    ...                                        sample_time=1e-3)
    >>> bank = CompensatorBank(structure, count=3)
    >>> bank.step(np.array([0.0, 5.0, -5.0]), np.full(3, np.nan)).tolist()  # nothing measured yet, nothing learned
    [75.0, 93.75, 56.25]
    """

    def __init__(
        self,
        structure: ModelStructure,
        count: int,
        x_limits: tuple[ArrayLike, ArrayLike] | None = None,
        learn: ArrayLike = True,
        *,
        x_start: ArrayLike | None = None,
        forgetting_time_s: float = 2.0,
        hand_over_s: float = 0.1,
        reset_s: float = 0.1,
        blend_time_s: float = 0.002,
        integral_gain: float = 0.0,
        rate_limit: float | None = None,
        dynamics: Dynamics | None = None,
        threads: int = 1,
    ) -> None:
        checks.instance(ModelStructure, structure=structure)
        checks.require(lambda d: d is None or isinstance(d, Dynamics), "a Dynamics or None", dynamics=dynamics)
        checks.whole(1, count=count, threads=threads)
        if dynamics is not None:
            dynamics.require(structure.sample_time)
        self.options: Options = packed(  # without types of NumPy, some of which compute in single precision
            {
                "forgetting_time_s": forgetting_time_s,
                "hand_over_s": hand_over_s,
                "reset_s": reset_s,
                "blend_time_s": blend_time_s,
                "integral_gain": integral_gain,
                "rate_limit": rate_limit,
            }
        )
        self.structure, self.threads, self.dynamics = structure, threads, dynamics
        prefilter = Prefilter(dynamics, structure.sample_time)
        self._modes, self._ring = prefilter.modes, 2 * prefilter.ring
        self._shape = *structure.shape, self._modes, self._ring
        self._dynamics = np.empty((0, 0 if dynamics is None else 3 * self._modes + 2))
        self.block, self._numbers = learner_numbers(structure, LearningSettings(mode="continuous", **self.options))
        """Samples of a block."""
        self.interval = int(self._numbers["interval"])
        """Samples from one optimum of an actuator to the next."""
        self._pool: ThreadPoolExecutor | None = None
        self._tiles = 0
        self._place(np.empty(0, np.int64))
        self._allocate(-(-count // LANES))
        self.add(count, x_limits, learn, x_start)

    def _allocate(self, tiles: int) -> None:
        """Allocate tiles and keep the existing ones."""
        s, shape, tiles_before = self.structure, self._shape, self._tiles
        before = [self._table(part) for part in TABLES if tiles_before]
        self._tiles = tiles
        core = State(
            bindings.bank_bytes(*shape, tiles, self.block),
            lambda block: bindings.bank_setup(block, *shape, tiles, self.block),
        )
        self._core = core
        options = self.options
        core["drive_settings"][:] = drive_settings(
            s, options["rate_limit"], blend_factor(s, options["blend_time_s"]), options["integral_gain"]
        )
        write_settings(self._numbers, core["settings"])
        write_slope_regressors(core, s)
        for part, old in zip(TABLES, before, strict=False):
            self._table(part)[:tiles_before] = old
        checkpoints = int(self._numbers["checkpoint"]) // self.interval
        for tile in range(tiles_before, tiles):
            late = math.floor(tile * GOLDEN % 1.0 * self.interval) + tile % checkpoints * self.interval
            bindings.bank_prepare(core.block, tile, late)
        # lanes without an actuator have an inverse, too
        for name, line in (("w_H", 0), ("w_S", s.middle), ("candidate", s.slices[1])):
            self._view(name)[tiles_before:, line] = 1.0
        workspace = bindings.bank_workspace_bytes(*shape, self.block)
        self._workspaces = [State(workspace, lambda block: {}) for _ in range(self.threads)]

    def _table(self, part: str) -> Matrix:
        """View (tiles, numbers) of one of `TABLES`."""
        first, numbers = self._core.offsets[part]
        table = self._core.block[first : first + 8 * numbers * self._tiles].view(np.float64)
        return table.reshape(self._tiles, numbers)

    def _view(self, name: str) -> Matrix:
        """View (tiles, numbers, LANES) of one of `LANE_BY_LANE`."""
        offsets = self._core.offsets
        at, length = offsets[name]
        table = [part for part in TABLES if offsets[part][0] <= at][-1]
        begin = (at - offsets[table][0]) // 8
        return self._table(table)[:, begin : begin + length].reshape(self._tiles, length // LANES, LANES)

    def _place(self, slots: Index) -> None:
        """Set the lane of each actuator, numbered over all tiles."""
        self._slots = slots
        self._in_order = slots.size == self._tiles * LANES and bool(np.all(slots[1:] > slots[:-1]))

    def __len__(self) -> int:
        return self._slots.size

    def _get(self, name: str, slots: Index) -> Matrix:
        return self._view(name)[slots // LANES, :, slots % LANES]

    def _set(self, name: str, slots: Index, values: ArrayLike) -> None:
        self._view(name)[slots // LANES, :, slots % LANES] = values

    def add(
        self,
        count: int,
        x_limits: tuple[ArrayLike, ArrayLike] | None = None,
        learn: ArrayLike = True,
        x_start: ArrayLike | None = None,
    ) -> None:
        """Append actuators, settled at ``x_start``, with the straight line through the ranges as model."""
        s = self.structure
        x_limits = s.x_range if x_limits is None else x_limits
        checks.require(
            lambda pair: len(pair) == 2 and all(np.shape(side) in ((), (count,)) for side in pair),
            f"two numbers, or two arrays of {count}",
            x_limits=x_limits,
        )
        low, high = (np.broadcast_to(reals("x_limits", side), (count,)) for side in x_limits)
        fits = (low < high) & (low >= -LARGEST) & (high <= LARGEST)
        if not np.all(fits):
            raise ValueError(f"x_limits[{int(np.argmin(fits))}] must be two numbers in ascending order, both finite")
        checks.flags(count, learn=learn)
        learning = np.concatenate([self.learning, np.broadcast_to(learn, (count,))])
        starts, which = np.unique(drive_start(low, high, x_start), return_inverse=True)
        settled = [OperatorState.settled_at(s, x).to_dict(s) for x in starts]
        taken = self._slots
        if taken.size + count > self._tiles * LANES:
            self._allocate(-(-(taken.size + count) // LANES))
        new = np.setdiff1d(np.arange(self._tiles * LANES), taken)[:count]
        self._place(np.concatenate([taken, new]))
        self._dynamics = np.pad(self._dynamics, ((0, count), (0, 0)))
        for name in LANE_BY_LANE:
            self._set(name, new, 0.0)
        self._set("drive_memory", new, drive_memory(s, low, high).T)
        self._set("play", new, np.array([state["play"] for state in settled])[which])
        self._set("creep", new, np.array([np.ravel(state["creep"]) for state in settled])[which])
        self._set_model(np.arange(taken.size, taken.size + count), self._line(self.dynamics))
        self.learning = learning

    def remove(self, which: ArrayLike) -> None:
        """Remove actuators by their numbers; the later ones move up and are otherwise unchanged."""
        which = self._numbered(which)
        gone = self._slots[which]
        self._view("memory")[gone // LANES, 0, gone % LANES] = 0.0
        self._place(np.delete(self._slots, which))
        self._dynamics = np.delete(self._dynamics, which, axis=0)

    def set_model(self, actuator: int, model: HysteresisCreepModel) -> None:
        """Set the model of an actuator, of the bank's structure; it learns from there, and its drive jumps."""
        checks.instance(HysteresisCreepModel, model=model)
        if model.structure != self.structure:
            raise ValueError("the model has another structure than the bank")
        if (model.dynamics is None) != (self.dynamics is None):
            raise ValueError("the model has dynamics and the bank has none, or the other way round")
        self._set_model(self._numbered(actuator), model)

    def _numbered(self, which: ArrayLike) -> Index:
        """Numbers of actuators, in ascending order; ValueError if one is not in the bank."""
        numbers = np.unique(which)
        for number in numbers.tolist():
            if not (isinstance(number, int) and not isinstance(number, bool) and 0 <= number < len(self)):
                raise ValueError(f"there are actuators 0 to {len(self) - 1}, and not {number}")
        return numbers.astype(np.int64)

    def _line(self, dynamics: Dynamics | None) -> HysteresisCreepModel:
        """The straight line through the ranges, with dynamics."""
        line = HysteresisCreepModel.from_weights(self.structure, self.structure.straight_line)
        return replace(line, dynamics=dynamics)

    def _prefilter(self, model: HysteresisCreepModel) -> Prefilter:
        """The prefilter of an actuator's model; ValueError if the loop would be unstable, or the bank has no room."""
        if self.options["integral_gain"] > 0.0:
            model.require_stable(self.options["integral_gain"])
        g = model.dynamics
        prefilter = Prefilter(g, self.structure.sample_time)
        if prefilter.modes != self._modes or prefilter.ring > self._ring:
            raise ValueError(f"the bank has room for {self._modes} modes and the lag of its own; the model has {g}")
        return prefilter

    def _set_model(self, which: Index, model: HysteresisCreepModel) -> None:
        slots, g, prefilter = self._slots[which], model.dynamics, self._prefilter(model)
        if g is not None:
            self._dynamics[which] = [*g.frequencies_Hz, *g.damping, *g.gains, g.delay_s, g.amplifier_lag_s]
            constants = np.zeros(self._view("prefilter").shape[1])
            constants[: prefilter.constants.size] = prefilter.constants
            self._set("prefilter", slots, constants)
            self._set("noise_gains", slots, prefilter.noise_gains)
        for name, values in (
            ("w_H", model.w_H),
            ("w_S", model.w_S_inverse),
            ("w_K", model.w_K),
            ("offset", model.offset),
            ("in_use", self.structure.inverse_slope_map @ model.weights),
        ):
            self._set(name, slots, values)
        for tile in np.unique(slots // LANES):
            lanes = np.zeros(LANES)
            lanes[slots[slots // LANES == tile] % LANES] = 1.0
            bindings.bank_begin(self._core.block, int(tile), lanes)

    @property
    def learning(self) -> Mask:
        """Flags (count,) of the actuators that learn, a read-only copy; assign all to switch learning on and off, which
        keeps what is learned."""
        flags: Mask = self._get("memory", self._slots)[:, 0] > 0.0
        flags.flags.writeable = False
        return flags

    @learning.setter
    def learning(self, which: ArrayLike) -> None:
        slots = self._slots
        checks.flags(slots.size, learning=which)
        self._view("memory")[slots // LANES, 0, slots % LANES] = which

    @property
    def counts(self) -> dict[str, Index]:
        """Numbers of hand-overs, refusals of new weights, sensor faults, and of those refusals because the output falls
        as the input rises, of each actuator."""
        memory = np.ascontiguousarray(self._get("memory", self._slots)).view(MEMORY)[:, 0]
        return {name: memory[name].astype(np.int64) for name in ("hand_overs", "refusals", "faults", "reversed")}

    @property
    def weights(self) -> Matrix:
        """The weights in use (count, ·): w_H0 … w_Hn, w'_S, w_K, offset."""
        return np.concatenate([self._get(name, self._slots) for name in ("w_H", "w_S", "w_K", "offset")], axis=1)

    @property
    def models(self) -> list[HysteresisCreepModel]:
        """The models in use."""
        models = [HysteresisCreepModel.from_all_weights(self.structure, weights) for weights in self.weights]
        if self.dynamics is None:
            return models
        return [replace(model, dynamics=g) for model, g in zip(models, map(self._of, self._dynamics), strict=True)]

    def _of(self, numbers: Vector) -> Dynamics:
        *modes, delay_s, amplifier_lag_s = numbers.tolist()
        f, zeta, gains = (tuple(modes[i * self._modes : (i + 1) * self._modes]) for i in range(3))
        return Dynamics(f, zeta, gains, delay_s, amplifier_lag_s)

    def step(self, y_ref: ArrayLike, y_measured_before: ArrayLike) -> Vector:
        """Process one sample of every actuator.

        Parameters
        ----------
        y_ref : array (count,)
            References in the output unit.
        y_measured_before : array (count,)
            Outputs that the drives of the last call produced; NaN if there is none.

        Returns
        -------
        array (count,)
            Drives in the input unit.
        """
        return self.run(reals("y_ref", y_ref)[None], reals("y_measured_before", y_measured_before)[None])[0]

    def run(self, y_ref: ArrayLike, y_measured_before: ArrayLike | None = None) -> Matrix:
        """Return the drives (N, count) of ``step`` for rows of references and outputs, to the last bit; without outputs
        nothing is learned."""
        y_ref = reals("y_ref", y_ref)
        y = np.full(y_ref.shape, math.nan) if y_measured_before is None else y_measured_before
        y_ref, y = checks.columns(len(self), y_ref=y_ref, y_measured_before=y)
        if not self._in_order:
            y_ref, y = self._spread(y_ref), self._spread(y)
        x = np.empty_like(y_ref)

        def share(i: int) -> None:
            first, last = (self._tiles * end // self.threads for end in (i, i + 1))
            bindings.bank_run(self._core.block, y_ref, y, x, self._workspaces[i].block, first, last)

        with self._core.exclusive():
            if self.threads > 1:
                self._pool = self._pool or ThreadPoolExecutor(self.threads - 1)
            others = [self._pool.submit(share, i) for i in range(1, self.threads)] if self._pool else []
            share(0)
            for other in others:
                other.result()
        return x if self._in_order else x[:, self._slots]

    def _spread(self, values: Matrix) -> Matrix:
        """Distribute values of the actuators to their lanes."""
        full = np.full((values.shape[0], self._tiles * LANES), math.nan)
        full[:, self._slots] = values
        return full

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_pool": None}  # a copy starts threads of its own

    def get_state(self) -> dict[str, Any]:
        """A copy of the whole state, without the settings."""
        return {"core": self._core.block.copy(), "slots": self._slots.copy(), "dynamics": self._dynamics.copy()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue, to the last bit, from the :meth:`get_state` of a bank of the same settings and number of tiles."""
        saved, lanes = convert(state, BankState), self._tiles * LANES
        slots = saved["slots"]
        if not (
            slots.dtype == np.int64
            and slots.ndim == 1
            and np.all((slots >= 0) & (slots < lanes))
            and np.unique(slots).size == slots.size
        ):
            raise ValueError(f"slots must be different whole numbers from 0 to {lanes - 1}")
        dynamics = saved.get("dynamics", np.empty((slots.size, 0)))  # which files of the version before lack
        if dynamics.shape != (slots.size, self._dynamics.shape[1]) or dynamics.dtype != np.float64:
            raise ValueError("dynamics must be numbers of each actuator")
        distinct, which = np.unique(dynamics, axis=0, return_inverse=True) if dynamics.shape[1] else ((), slots)
        prefilters = [self._prefilter(self._line(self._of(numbers))) for numbers in distinct]
        self._core.restore(saved["core"], bindings.bank_restore)
        self._place(slots.copy())
        self._dynamics = dynamics.copy()
        for i, prefilter in enumerate(prefilters):  # the constants of the core follow from the dynamics
            own = slots[which == i]
            self._set("prefilter", own, prefilter.with_states(self._get("prefilter", own)))
            self._set("noise_gains", own, prefilter.noise_gains)

    def save(self, path: str | Path) -> None:
        """Write settings and state as NPZ; the file is replaced as a whole."""
        about = {
            "format": BankFile.FORMAT,
            "version": BankFile.VERSION,
            "structure": self.structure.to_dict(),
            "tiles": self._tiles,
            "options": self.options,
            "dynamics": None if self.dynamics is None else self.dynamics.to_dict(),
        }
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, about=np.array(json.dumps(packed(about))), **self.get_state())

    @classmethod
    def load(cls, path: str | Path, threads: int = 1) -> Self:
        """Continue, to the last bit, from a file of :meth:`save`; ModelError names what is wrong with it."""
        try:
            with Path(path).open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                about, state = (
                    decoded(str(file["about"]), BankFile),
                    {name: file[name] for name in file.files if name != "about"},
                )
            bank = cls(about.structure, 1, threads=threads, dynamics=about.dynamics, **about.options)
            if state["core"].size != bindings.bank_bytes(*bank._shape, about.tiles, bank.block):
                raise ValueError(
                    f"the field 'tiles' is {about.tiles}, and the state is of another number or of another structure"
                )
            bank._allocate(about.tiles)
            bank.restore(state)
        except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            raise ModelError(f"{path}: does not hold a whole bank: {error}") from None
        return bank
