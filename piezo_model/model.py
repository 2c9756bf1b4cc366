"""The modified Prandtl–Ishlinskii model with creep, equation (2), in normalised units:

    y = S[ H[x] + K[x] + offset ],   H[x] = Σ w_Hi H_rHi[x],   K[x] = Σ w_Ki K_rKi[x],   S[u] = Σ w_Si S_rSi(u)

The identification gives S⁻¹ (weights w'_S over the thresholds r'_S of the structure), which the model stores; S is its
analytic inverse. K_rKi is the sum of one creep state per rate, all with the weight w_Ki. Structural dynamics may follow
(`dynamics`).

Source: K. Kuhnen, European Journal of Control 9 (2003) 407–418; `operators` for the elementary operators.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast, get_args

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from piezo_model import checks, json_file, simulation
from piezo_model.core import Immutable
from piezo_model.dynamics import Dynamics, KnownDynamics, delayed
from piezo_model.json_file import LARGEST, Number, ReadOnly, unpacked
from piezo_model.operator_state import OperatorState, States
from piezo_model.structure import SMALLEST, ModelStructure
from piezo_model.units import quantity
from solvers.arrays import Vector, read_only, reals

if TYPE_CHECKING:
    from piezo_model.identification.validation import Validation
    from piezo_model.recordings import Recording

StartChoice = Literal["recording", "rest"]


class ModelError(ValueError):
    """An invalid model, or a file that is not a model; the message is a sentence with the reason."""


@dataclass(frozen=True)
class Provenance:
    """The recordings from which a model was identified."""

    recording: str
    """Digest of the first recording."""
    skipped: Annotated[int, msgspec.Meta(ge=0)]
    """Number of first samples that were not counted."""
    later: tuple[States, ...]
    """States before each part but the first."""
    others: tuple[str, ...] = ()
    """Digests of the other recordings."""

    @property
    def digests(self) -> tuple[str, ...]:
        """Digests of all recordings."""
        return self.recording, *self.others


class ModelFile(json_file.Versioned):
    """The content of :meth:`HysteresisCreepModel.to_dict`."""

    FORMAT = "piezobench-model"
    VERSION = 3
    UPGRADE_HINT = "identify again from the recording"
    structure: ModelStructure
    w_H: list[Number]
    w_S_inverse: list[Number]
    w_K: list[Number]
    offset: Number
    start: States | None = None
    dynamics: Dynamics | None = None
    left_out: Dynamics | None = None
    sensor_delay_s: Number = 0.0
    fitted: Provenance | None = None
    report: dict[str, Any] = msgspec.field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class HysteresisCreepModel(Immutable):
    """A valid model: structure, weights and, after an identification, its report, all of it copied and read-only.

    Parameters
    ----------
    structure : ModelStructure
    w_H : array (n + 1,)
        Hysteresis weights, w_H0 > 0 and the others ≥ 0.
    w_S_inverse : array (2m + 1,)
        Weights w'_S of S⁻¹ over the structure's dead zones; their partial sums outwards from zero, the slopes, are > 0.
    w_K : array (n + 1,)
        Creep weights ≥ 0; empty for a model without creep.
    offset : float
        Constant inside S, in normalised units.
    report : mapping
        Results of the identification, for information; stored with the model.
    start : OperatorState, optional
        Identified states before the first sample of the recording of the identification.
    dynamics : Dynamics, optional
        Resonance, delay and lag in addition to equation (2); none by default.
    left_out : Dynamics, optional
        Dynamics of the stage that the model does not have, or has only in part; they still act in a loop around the
        stage.
    sensor_delay_s : float
        Delay of the sensor that is not in the model; it still acts in a loop that the sensor closes.
    fitted : Provenance, optional
        The recordings from which the weights were identified.

    Raises
    ------
    ModelError
        If the model is not invertible.
    """

    structure: ModelStructure
    w_H: Vector
    w_S_inverse: Vector
    w_K: Vector
    offset: float = 0.0
    report: Mapping[str, Any] = field(default_factory=dict)
    start: OperatorState | None = None
    dynamics: Dynamics | None = None
    left_out: Dynamics | None = None
    sensor_delay_s: float = 0.0
    fitted: Provenance | None = None

    def __post_init__(self) -> None:
        s = self.structure
        checks.instance(ModelStructure, structure=s)
        checks.instance(Mapping, report=self.report)
        for name, size in (("w_H", s.n + 1), ("w_S_inverse", s.dead_zones), ("w_K", s.creep_weights)):
            values = read_only(reals(name, getattr(self, name)))
            checks.check(
                values.shape == (size,),
                f"{name} must have {size} values for this structure, not shape {values.shape}",
                ModelError,
            )
            object.__setattr__(self, name, values)
        with checks.refusing(ModelError):
            checks.finite_arrays(w_H=self.w_H, w_S_inverse=self.w_S_inverse, w_K=self.w_K)
            checks.between(-LARGEST, LARGEST, offset=self.offset)
        object.__setattr__(self, "report", ReadOnly(self.report))
        if self.start is not None:
            OperatorState.check_fits(self.start, s)
            object.__setattr__(self, "start", OperatorState(*map(read_only, (self.start.play, self.start.creep))))
        with checks.refusing(ModelError, "fitted: "):
            for state in self.starts[1:]:
                state.check_fits(s)
        checks.require(
            lambda d: d is None or isinstance(d, Dynamics),
            "a Dynamics or None",
            dynamics=self.dynamics,
            left_out=self.left_out,
        )
        checks.require(lambda t: 0.0 <= t <= LARGEST, f"from 0 to {LARGEST:g} s", sensor_delay_s=self.sensor_delay_s)
        if self.dynamics is not None:
            with checks.refusing(ModelError):
                self.dynamics.check_sample_time(s.sample_time)
        checks.check(
            not self.offset or s.offset,
            f"the structure has no offset, and the model has one of {self.offset:g}",
            ModelError,
        )
        checks.check(
            self.w_H[0] >= SMALLEST,
            f"w_H[0] must be positive for the model to have an inverse, not {self.w_H[0]:g}",
            ModelError,
        )
        for name in ("w_H", "w_K"):
            values = getattr(self, name)
            if np.any(values < 0.0):
                i = int(np.argmin(values))
                raise ModelError(f"{name}[{i}] must not be negative, not {values[i]:g}")
        if np.any(self.slopes < SMALLEST):
            i = int(np.argmin(self.slopes))
            raise ModelError(
                f"the slope of S⁻¹ beyond threshold {s.dead_zone_thresholds[i]:g} must be positive for the "
                f"model to have an inverse, and it is {self.slopes[i]:g}"
            )

    @classmethod
    def from_weights(cls, structure: ModelStructure, w: ArrayLike) -> HysteresisCreepModel:
        """Make the model of identified unknowns w (d,) in weight coordinates and normalised units, with w_H0 = 1."""
        w = reals("w", w)
        checks.check(
            w.shape == (structure.d,),
            f"w must have {structure.d} values for this structure, not shape {w.shape}",
            ModelError,
        )
        return cls.from_all_weights(structure, simulation.all_weights(structure, w))

    @classmethod
    def from_all_weights(cls, structure: ModelStructure, weights: Vector) -> HysteresisCreepModel:
        """Make the model that has these :attr:`all_weights`."""
        w_H, w_S, w_K, offset = simulation.split(structure, weights)
        return cls(structure, w_H, w_S, w_K, float(offset[0]))

    @property
    def all_weights(self) -> Vector:
        """All weights in the order of the core's compensator: w_H0 … w_Hn, w'_S, w_K, offset."""
        return np.concatenate([self.w_H, self.w_S_inverse, self.w_K, [self.offset]])

    @property
    def weights(self) -> Vector:
        """The unknowns w of the identification, scaled so that w_H0 = 1; shape (d,)."""
        return self.all_weights[1 : self.structure.d + 1] / self.w_H[0]

    @cached_property
    def slopes(self) -> Vector:
        """Slopes of the piecewise linear S⁻¹, from the outermost negative to the outermost positive piece."""
        s = self.structure
        return read_only(s.slopes_of(self.all_weights[1 : s.d + 1])[s.slices[1]])

    @cached_property
    def arrays(self) -> simulation.Arrays:
        """The parameters of the core."""
        return simulation.arrays_of(self.structure, self.all_weights)

    def simulate(self, x: ArrayLike | Recording, state: OperatorState | None = None) -> Vector:
        """Output of the model.

        Parameters
        ----------
        x : array (N,) or Recording
            Input in the structure's input unit; a recording in other units is converted, and may have another sampling
            period.
        state : OperatorState, optional
            States before the first sample. By default, for a recording the states that fit it best, as in the
            identification; for an array the model's :attr:`start`, or else those of a compensator's stage at rest.

        Returns
        -------
        array (N,)
            Output in the structure's output unit.

        Examples
        --------
        >>> structure = ModelStructure.equidistant(n=1, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(),
        ...                                        sample_time=1e-3)
        >>> model = HysteresisCreepModel.from_weights(structure, [1.0, 2.0])
        >>> model.simulate([0.0, 1.0, 0.0]).tolist()
        [0.0, 0.75, 0.25]
        """
        if hasattr(x, "counted_y"):  # a Recording, whose class is not imported: it imports the readers of all formats
            from piezo_model.identification.validation import simulate_recording  # which uses this class

            return simulate_recording(self, cast("Recording", x), state)
        state = self.initial_state() if state is None else state
        OperatorState.check_fits(state, self.structure)
        drive = checks.vectors(x=x)[0]  # type: ignore[arg-type]
        return simulation.respond(self.structure, self.arrays, self.dynamics, drive, state)

    def advance(self, x: ArrayLike, state: OperatorState) -> tuple[Vector, OperatorState]:
        """Output of the model for a chunk of a signal; ModelError for a model with dynamics.

        Parameters
        ----------
        x : array (N,)
            Input in the structure's input unit.
        state : OperatorState
            States before the first sample.

        Returns
        -------
        y : array (N,)
            Output in the structure's output unit.
        state : OperatorState
            States after the last sample, for the next chunk.

        Examples
        --------
        >>> structure = ModelStructure.equidistant(n=1, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(),
        ...                                        sample_time=1e-3)
        >>> model = HysteresisCreepModel.from_weights(structure, [1.0, 2.0])
        >>> y, state = model.advance([0.0, 1.0], model.initial_state())
        >>> y.tolist(), model.advance([0.0], state)[0].tolist()
        ([0.0, 0.75], [0.25])
        """
        checks.check(
            self.dynamics is None,
            f"advance needs a model without dynamics, and this one has {self.dynamics}; use static",
            ModelError,
        )
        OperatorState.check_fits(state, self.structure)
        (x,) = checks.vectors(x=x)
        return simulation.advance(self.structure, self.arrays, x, state)

    @property
    def static(self) -> HysteresisCreepModel:
        """The model without its dynamics, with a warning if there are any."""
        if self.dynamics is None:
            return self
        return replace(self, dynamics=None, left_out=self.dynamics)

    @property
    def with_sensor(self) -> HysteresisCreepModel:
        """The model with the delay of its sensor, as in a recording."""
        return replace(self, dynamics=delayed(self.dynamics, self.sensor_delay_s), left_out=None, sensor_delay_s=0.0)

    def with_dynamics_of(self, other: HysteresisCreepModel) -> HysteresisCreepModel:
        """These weights with the dynamics of another model, including those that it leaves out."""
        return replace(self, **vars(other.known_dynamics))

    @property
    def known_dynamics(self) -> KnownDynamics:
        """What a loop around the stage meets."""
        return KnownDynamics(self.dynamics, self.left_out, self.sensor_delay_s)

    @property
    def lag_s(self) -> float:
        """Time by which the output lags a slow reference behind the inverse of the dynamics, in s; 0 without any."""
        return 0.0 if self.dynamics is None else self.dynamics.lag_s(self.structure.sample_time)

    def require_stable(self, integral_gain: float, *, inverts: bool = True) -> float:
        """The stability limit of the gain of integral action, in 1/s, with all dynamics of the stage and its sensor,
        even if the model leaves them out; infinite without dynamics. ModelError if the gain is not below the limit."""
        inverted, dynamics = (
            self.dynamics if inverts else None,
            delayed(self.left_out or self.dynamics, self.sensor_delay_s),
        )
        if dynamics is None:
            return math.inf
        most = dynamics.largest_gain(self.structure.sample_time, inverted)
        checks.check(
            integral_gain < most,
            f"integral_gain must be below {most:.4g} per second, not {integral_gain:g}: with {dynamics}"
            f"{', not inverted' * (inverted is None)}, the loop would be unstable",
            ModelError,
        )
        return most

    @property
    def warning(self) -> str:
        """A warning for a model that was forced, lacks dynamics of the stage, or has a delay and another sampling
        period than that of its identification; "" for any other model."""
        without = "has only the static gain of the fastest modes" if self.dynamics else "has no dynamics"
        left_out = self.left_out and f"the stage has {self.left_out}"
        reasons = {"was forced": self.report.get("refusal"), without: left_out}
        sentences = [f"The model {how} although {why}." for how, why in reasons.items() if why is not None]
        now, own = self.structure.sample_time, self.report.get("sample_time_s")
        if self.dynamics is not None and isinstance(own, float) and not math.isclose(now, own, rel_tol=1e-6):
            wrong = f"{quantity(abs(own - now), 's', 3)} too {'long' if own > now else 'short'}"
            sentences.append(
                f"The model was identified with a sample every {quantity(own, 's', 3)} and has one every "
                f"{quantity(now, 's', 3)}: its delay is counted from the end of the sampling interval, and is {wrong} "
                "if the sensor is read at the start of the interval."
            )
        return " ".join(" ".join(sentences).split())

    def at(self, sample_time: float) -> HysteresisCreepModel:
        """The same model at another sampling period in s, as of a controller or a signal.

        Plays do not depend on time, and creep rates are in 1/s, so weights and states are unchanged. The report is that
        of the identification, with its sampling period as ``sample_time_s``. The model itself is returned for its own
        period, within one millionth for the rounding of a clock. A mode above 35 % of the sampling rate is reduced to
        its static gain, which is shown by ``left_out`` and the warning.

        Raises
        ------
        StructureError, ModelError
            The sampling period is out of range, or too short for the dynamics.

        Examples
        --------
        >>> structure = ModelStructure.equidistant(n=1, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(1.0,),
        ...                                        sample_time=5e-3)
        >>> model = HysteresisCreepModel.from_weights(structure, [1.0, 2.0, 0.1, 0.0])
        >>> bool(np.isclose(model.simulate(np.ones(201))[-1], model.at(125e-6).simulate(np.ones(8001))[-1]))
        True
        """
        own, structure = self.structure.sample_time, replace(self.structure, sample_time=sample_time)
        if math.isclose(sample_time, own, rel_tol=1e-6):
            return self
        dynamics = self.dynamics and self.dynamics.below(sample_time)
        return replace(
            self,
            structure=structure,
            dynamics=dynamics,
            left_out=self.left_out or (None if dynamics == self.dynamics else self.dynamics),
            report={"sample_time_s": own, **self.report},
        )

    def initial_state(self, start: StartChoice | None = None) -> OperatorState:
        """States before a signal: those before the recording of the identification, or those of a compensator's stage
        at rest; by default the former, if the model has them."""
        checks.one_of(get_args(StartChoice), start="rest" if start is None else start)
        checks.check(
            start != "recording" or self.start is not None,
            "the model has no states from before a recording; begin at rest",
            ModelError,
        )
        if start == "rest" or self.start is None:
            return OperatorState.before_drive(self.structure)
        return self.start.copy()

    @property
    def starts(self) -> list[OperatorState]:
        """The states before each part of the recording of the identification; empty without a recording."""
        later = () if self.fitted is None else self.fitted.later
        return [] if self.start is None else [self.start, *(OperatorState.from_dict(z, self.structure) for z in later)]

    def validate(self, recording: Recording) -> Validation:
        """Validate the model on a recording, which should not be that of its identification.

        Raises
        ------
        IdentificationError
            The recording does not fit the model.
        UnitError
            It is in units that cannot be converted to the model's.
        """
        from piezo_model.identification.validation import validate  # which simulates with this class

        return validate(self, recording)

    def figures(self) -> dict[str, tuple[float, float | None, float | None]]:
        """Data-sheet figures by name: the value and the ends of its interval at 95 %, if there is one.

        Gain in output unit per input unit, hysteresis in % of the travel, creep in % per decade of time, and offset in
        the input unit; see :mod:`piezo_model.figures`.

        Examples
        --------
        >>> structure = ModelStructure.equidistant(n=1, m=0, x_range=(0, 100), y_range=(0, 20), creep_rates=(),
        ...                                        sample_time=1e-3)
        >>> HysteresisCreepModel.from_weights(structure, [0.0, 1.0]).figures()["gain"]
        (0.2, None, None)
        """
        from piezo_model.figures import figures_of  # which uses the operators' states

        known = (self.report.get("intervals") or {}).get("figures", {})
        return {name: (value, *known.get(name, (None, None))) for name, value in figures_of(self).items()}

    def to_dict(self) -> dict[str, Any]:
        """The model as JSON types; floats are kept to the bit."""
        return {
            "format": ModelFile.FORMAT,
            "version": ModelFile.VERSION,
            "structure": self.structure.to_dict(),
            "w_H": self.w_H.tolist(),
            "w_S_inverse": self.w_S_inverse.tolist(),
            "w_K": self.w_K.tolist(),
            "offset": float(self.offset),
            "start": None if self.start is None else self.start.to_dict(self.structure),
            **{name: getattr(self, name) and getattr(self, name).to_dict() for name in ("dynamics", "left_out")},
            "sensor_delay_s": float(self.sensor_delay_s),
            "fitted": self.fitted and asdict(self.fitted),
            "report": dict(self.report),
        }

    @classmethod
    def from_file(cls, file: ModelFile) -> HysteresisCreepModel:
        """Make the model of :meth:`to_dict`; ValueError names what is inconsistent."""
        start = None if file.start is None else OperatorState.from_dict(file.start, file.structure)
        return cls(
            file.structure,
            np.array(file.w_H),
            np.array(file.w_S_inverse),
            np.array(file.w_K),
            file.offset,
            unpacked(file.report),
            start,
            file.dynamics,
            file.left_out,
            file.sensor_delay_s,
            file.fitted,
        )

    def save(self, path: str | Path) -> None:
        """Write the model as JSON; the file is replaced as a whole."""
        json_file.write(path, self.to_dict(), ModelError)

    @classmethod
    def load(cls, path: str | Path) -> HysteresisCreepModel:
        """Read a model that :meth:`save` wrote; ModelError names the file and what is wrong with it."""
        file = json_file.read(path, ModelFile, ModelError)
        with checks.refusing(ModelError, f"{path}: is not a valid model: "):
            return cls.from_file(file)
