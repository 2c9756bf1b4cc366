"""Thousands of self-learning compensators of one structure: tiles of eight actuators, one in each lane of a vector
(``core/bank.h``).

Each actuator has its own weights, states, limits and sensor guard, and affects no bit of another one. The drive is that
of `Compensator`; learning is that of the continuous mode of `SelfLearningCompensator`, in the given ranges of the
structure.
"""

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Self, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_model import checks
from piezo_model.compensator import BUMP, blend_factor, drive_memory, drive_settings
from piezo_model.core import State, Stateful, bindings, exclusively
from piezo_model.dynamics import Dynamics, KnownDynamics
from piezo_model.json_file import LARGEST, convert
from piezo_model.learning.learner_file import read_learner, write_learner
from piezo_model.learning.settings import MEMORY, LearningSettings, learner_numbers, write_settings
from piezo_model.model import HysteresisCreepModel, ModelError
from piezo_model.operator_state import drive_start
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
OPTIONS = ("forgetting_time_s", "hand_over_s", "reset_s", "blend_time_s", "integral_gain", "rate_limit")
"""Settings of learning that a bank has."""


class BankState(TypedDict):
    """State of a bank, without the settings."""

    core: np.ndarray
    slots: np.ndarray
    dynamics: list[KnownDynamics]


class BankSettings(TypedDict):
    """Settings of a bank in a file."""

    structure: ModelStructure
    dynamics: Dynamics | None
    learning: LearningSettings


def lanes(slots: Index, numbers: int | slice = slice(None)) -> tuple[Any, ...]:
    """Index of lanes, numbered over all tiles, in a view of :meth:`CompensatorBank._view`."""
    return slots // LANES, numbers, slots % LANES


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
        checks.whole(1, count=count, threads=threads)
        self._line = replace(HysteresisCreepModel.from_weights(structure, structure.straight_line), dynamics=dynamics)
        """The straight line through the ranges, with the dynamics of the bank."""
        self.structure, self.threads, self.dynamics = structure, threads, dynamics
        self.settings = LearningSettings(
            mode="continuous",
            forgetting_time_s=forgetting_time_s,
            hand_over_s=hand_over_s,
            reset_s=reset_s,
            blend_time_s=blend_time_s,
            integral_gain=integral_gain,
            rate_limit=rate_limit,
        )
        prefilter = Prefilter(dynamics, structure.sample_time)
        self._modes, self._ring = prefilter.modes, 2 * prefilter.ring
        self._shape = *structure.shape, self._modes, self._ring
        self._known: NDArray[np.object_] = np.empty(0, np.object_)
        self.block, self._numbers = learner_numbers(structure, self.settings)
        """Samples of a block."""
        self.interval = int(self._numbers["interval"])
        """Samples from one optimum of an actuator to the next."""
        self._pool: ThreadPoolExecutor | None = None
        self._tiles = 0
        self._allocate(-(-count // LANES))
        self._place(np.empty(0, np.int64))
        self.add(count, x_limits, learn, x_start)

    def _allocate(self, tiles: int) -> None:
        """Allocate tiles and keep the existing ones."""
        s, settings, before = self.structure, self.settings, self._tiles
        kept = [self._view(part) for part in TABLES if before]
        core = State(
            bindings.bank_bytes(*self._shape, tiles, self.block),
            lambda block: bindings.bank_setup(block, *self._shape, tiles, self.block),
        )
        core["drive_settings"][:] = drive_settings(
            s, settings.rate_limit, blend_factor(s, settings.blend_time_s), settings.integral_gain
        )
        write_settings(self._numbers, core["settings"])
        write_slope_regressors(core, s)
        self._core, self._tiles = core, tiles
        for part, old in zip(TABLES, kept, strict=False):
            self._view(part)[:before] = old
        checkpoints = int(self._numbers["checkpoint"]) // self.interval
        for tile in range(before, tiles):
            late = math.floor(tile * GOLDEN % 1.0 * self.interval) + tile % checkpoints * self.interval
            bindings.bank_prepare(core.block, tile, late)
        # lanes without an actuator have an inverse, too
        for name, line in (("w_H", 0), ("w_S", s.middle), ("candidate", s.slices[1])):
            self._view(name)[before:, line] = 1.0
        self._workspaces = [
            State(bindings.bank_workspace_bytes(*self._shape, self.block), lambda block: {})
            for _ in range(self.threads)
        ]

    def _view(self, name: str) -> Matrix:
        """View (tiles, numbers, LANES) of one of `TABLES`, or of a part of these with numbers of each actuator."""
        first, numbers = self._core.offsets[name]
        stride = [length for begin, length in map(self._core.offsets.__getitem__, TABLES) if begin <= first][-1]
        shape, strides = (self._tiles, numbers // LANES, LANES), (8 * stride, 8 * LANES, 8)
        return np.ndarray(shape, np.float64, self._core.block, first, strides)

    def _write(self, slots: Index, **parts: ArrayLike) -> None:
        """Write numbers (·,) or (count, ·) of each part to lanes."""
        for name, values in parts.items():
            self._view(name)[lanes(slots)] = values

    def _place(self, slots: Index) -> None:
        """Set the lane of each actuator, numbered over all tiles."""
        self._slots = slots
        self._in_order = slots.size == self._tiles * LANES and bool(np.all(slots[1:] > slots[:-1]))

    def __len__(self) -> int:
        return self._slots.size

    @exclusively
    def add(
        self,
        count: int,
        x_limits: tuple[ArrayLike, ArrayLike] | None = None,
        learn: ArrayLike = True,
        x_start: ArrayLike | None = None,
    ) -> None:
        """Append actuators, settled at ``x_start``, with the straight line through the ranges as model."""
        checks.whole(0, count=count)
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
        unit = s.unit_input(drive_start(low, high, x_start))[:, None]
        settled = unit + np.clip(-unit, -1.0, 1.0) * s.thresholds  # as of OperatorState.settled_at
        total = len(self) + count
        if total > self._tiles * LANES:
            self._allocate(-(-total // LANES))
        new = np.setdiff1d(np.arange(self._tiles * LANES), self._slots)[:count]
        self._place(np.concatenate([self._slots, new]))
        self._known = np.append(self._known, [None] * count)
        self._write(
            new,
            drive_memory=drive_memory(s, low, high).T,
            play=settled,
            creep=np.tile(settled, len(s.creep_rates)),
            memory=0.0,
        )
        self._view("memory")[lanes(new, 0)] = learn
        self.set_model(np.arange(total - count, total), self._line)

    @exclusively
    def remove(self, which: ArrayLike) -> None:
        """Remove actuators by their numbers; the later ones move up and are otherwise unchanged."""
        which = self._numbered(which)
        self._view("memory")[lanes(self._slots[which], 0)] = 0.0
        self._place(np.delete(self._slots, which))
        self._known = np.delete(self._known, which)

    @exclusively
    def set_model(self, actuator: ArrayLike, model: HysteresisCreepModel) -> None:
        """Set the model of actuators, of the bank's structure; they learn from there, and their drives jump."""
        checks.instance(HysteresisCreepModel, model=model)
        checks.check(model.structure == self.structure, "the model has another structure than the bank")
        which, prefilter = self._numbered(actuator), self._prefilter(model)
        self._known[which], slots = model.known_dynamics, self._slots[which]
        self._write(
            slots,
            prefilter=prefilter.with_states(self._view("prefilter")[lanes(slots)]),  # keeps the places in rings
            noise_gains=prefilter.noise_gains,
            w_H=model.w_H,
            w_S=model.w_S_inverse,
            w_K=model.w_K,
            offset=model.offset,
            in_use=self.structure.slopes_of(model.weights),
        )
        self._view("drive_memory")[lanes(slots, BUMP)] = 0.0  # of a hand-over before
        begin = np.isin(np.arange(self._tiles * LANES), slots).astype(np.float64).reshape(-1, LANES)
        for tile in np.unique(slots // LANES).tolist():
            bindings.bank_begin(self._core.block, tile, begin[tile])

    def _numbered(self, which: ArrayLike) -> Index:
        """Numbers of actuators, in ascending order; ValueError if one is not in the bank."""
        numbers, last = np.ravel(which).tolist(), len(self) - 1
        for number in numbers:
            checks.require(lambda n: isinstance(n, int) and 0 <= n <= last, f"from 0 to {last}", actuator=number)
        return np.unique(np.array(numbers, np.int64))

    def _prefilter(self, model: HysteresisCreepModel) -> Prefilter:
        """The prefilter of an actuator's model; ValueError if the loop would be unstable, or the bank has no room."""
        if self.settings.integral_gain > 0.0:
            model.require_stable(self.settings.integral_gain)
        prefilter, has = Prefilter(model.dynamics, self.structure.sample_time), model.dynamics or "none"
        room = f"for {self._modes} modes and the lag of its own" if self._ring else "for no dynamics"
        checks.check(
            (prefilter.modes, prefilter.ring > 0) == (self._modes, self._ring > 0) and prefilter.ring <= self._ring,
            f"the bank has room {room}; the model has {has}",
        )
        return prefilter

    @property
    def learning(self) -> Mask:
        """Flags (count,) of the actuators that learn, a read-only copy; assign all to switch learning on and off, which
        keeps what is learned."""
        flags: Mask = self._view("memory")[lanes(self._slots, 0)] > 0.0
        flags.flags.writeable = False
        return flags

    @learning.setter
    @exclusively
    def learning(self, which: ArrayLike) -> None:
        checks.flags(len(self), learning=which)
        self._view("memory")[lanes(self._slots, 0)] = which

    @property
    def counts(self) -> dict[str, Index]:
        """Numbers of hand-overs, refusals of new weights, sensor faults, and of those refusals because the output falls
        as the input rises, of each actuator."""
        memory = np.ascontiguousarray(self._view("memory")[lanes(self._slots)]).view(MEMORY)[:, 0]
        return {name: memory[name].astype(np.int64) for name in ("hand_overs", "refusals", "faults", "reversed")}

    @property
    def weights(self) -> Matrix:
        """The weights in use (count, ·): w_H0 … w_Hn, w'_S, w_K, offset."""
        return np.hstack([self._view(name)[lanes(self._slots)] for name in ("w_H", "w_S", "w_K", "offset")])

    @property
    def models(self) -> list[HysteresisCreepModel]:
        """The models in use."""
        return [
            replace(HysteresisCreepModel.from_all_weights(self.structure, weights), **vars(known))
            for weights, known in zip(self.weights, self._known, strict=True)
        ]

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

    @exclusively
    def run(self, y_ref: ArrayLike, y_measured_before: ArrayLike | None = None) -> Matrix:
        """Return the drives (N, count) of ``step`` for rows of references and outputs, to the last bit; without outputs
        nothing is learned."""
        y_ref = reals("y_ref", y_ref)
        y = np.full(y_ref.shape, math.nan) if y_measured_before is None else y_measured_before
        y_ref, y = checks.vectors(len(self), y_ref=y_ref, y_measured_before=y)
        if not self._in_order:
            spread = np.full((2, len(y), self._tiles * LANES), math.nan)
            spread[:, :, self._slots] = y_ref, y
            y_ref, y = spread
        x = np.empty_like(y_ref)

        def share(i: int) -> None:
            first, last = (self._tiles * end // self.threads for end in (i, i + 1))
            bindings.bank_run(self._core.block, y_ref, y, x, self._workspaces[i].block, first, last)

        if self.threads > 1:
            self._pool = self._pool or ThreadPoolExecutor(self.threads - 1)
        others = [self._pool.submit(share, i) for i in range(1, self.threads)] if self._pool else []
        share(0)
        for other in others:
            other.result()
        return x if self._in_order else x[:, self._slots]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_pool": None}  # a copy starts threads of its own

    @exclusively
    def get_state(self) -> dict[str, Any]:
        """A copy of the whole state, without the settings."""
        return {
            "core": self._core.block.copy(),
            "slots": self._slots.copy(),
            "dynamics": [asdict(known) for known in self._known],
        }

    @exclusively
    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue, to the last bit, from the :meth:`get_state` of a bank of the same settings and number of tiles."""
        saved, most = convert(state, BankState), self._tiles * LANES
        slots, dynamics = saved["slots"], saved["dynamics"]
        checks.check(
            slots.dtype == np.int64
            and slots.ndim == 1
            and np.all((slots >= 0) & (slots < most))
            and np.unique(slots).size == slots.size == len(dynamics),
            f"slots must be different whole numbers from 0 to {most - 1}, one for each of the dynamics",
        )
        prefilters = {known: self._prefilter(replace(self._line, **vars(known))) for known in dict.fromkeys(dynamics)}
        self._core.restore(saved["core"], bindings.bank_restore)
        self._place(slots.copy())
        self._known = np.array(dynamics, np.object_)
        constants, gains = self._view("prefilter"), self._view("noise_gains")
        for known, tile, lane in zip(dynamics, *np.divmod(slots, LANES), strict=True):  # they follow from the dynamics
            constants[tile, :, lane] = prefilters[known].with_states(constants[tile, :, lane])
            gains[tile, :, lane] = prefilters[known].noise_gains

    def save(self, path: str | Path) -> None:
        """Write settings and state as JSON; the file is replaced as a whole."""
        settings = {
            "structure": self.structure.to_dict(),
            "dynamics": self.dynamics and self.dynamics.to_dict(),
            "learning": asdict(self.settings),
        }
        write_learner(path, settings, self.get_state())

    @classmethod
    def load(cls, path: str | Path, threads: int = 1) -> Self:
        """Continue, to the last bit, from a file of :meth:`save`; ModelError names what is wrong with it."""
        checks.whole(1, threads=threads)
        fields, state = read_learner(path)
        with checks.refusing(ModelError, f"{path}: does not hold a whole bank: "):
            saved = convert(fields, BankSettings)
            bank = cls(
                saved["structure"],
                LANES,
                dynamics=saved["dynamics"],
                threads=threads,
                **{name: getattr(saved["learning"], name) for name in OPTIONS},
            )
            heads = bindings.bank_bytes(*bank._shape, 0, bank.block)
            tiles = (convert(state, BankState)["core"].size - heads) // (bank._core.block.size - heads)
            bank._allocate(max(1, tiles))
            bank.restore(state)
            return bank
