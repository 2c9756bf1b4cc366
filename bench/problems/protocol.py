"""A problem that owns its certified optimum, in each scaling in which it is raced."""

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal, NotRequired, Self, TypedDict

import numpy as np
import qpsolvers
from qpsolvers import Problem

from bench.problem_files.npz import opened, packed, packed_program, unpacked, unpacked_program
from bench.problem_files.program import ProblemFileError, doubles
from piezo_model import HysteresisCreepModel, IdentificationProblem, ModelStructure, OperatorState
from piezo_model.atomic_file import replacing
from piezo_model.identification_problem import Scaling
from piezo_model.json_file import FileName, decoded
from solvers.arrays import Matrix, Vector
from solvers.certificate import Certificate, certify

SCALINGS: tuple[Scaling, ...] = ("scaled", "raw")


class ProblemSetError(ValueError):
    """What a problem set needs and does not have; the message is one sentence."""


@dataclass(frozen=True)
class Window:
    """Another program of the same variables and constraints, of a neighbouring window of the same data."""

    P: Matrix
    q: Vector
    c: float


@dataclass(frozen=True)
class CertifiedForm:
    """One scaling of a problem: the program in z, the weights w = ``to_weights`` z, and the proof of its optimum."""

    qp: Problem
    """Matrices dense or in compressed sparse columns."""
    c: float
    """Constant term of the cost."""
    to_weights: Any
    """Shape (d, d)."""
    certificate: Certificate
    warm_start: Vector | None = None
    """The optimum of the problem before this one, in the variables z of this one, where problems follow each other.
    Shape (d,)."""
    cost_unit: float = 0.0
    """One unit of the raw program's cost, for programs of others, whose constant means nothing; 0 where V + c is a sum
    of squares."""
    windows: tuple[Window, ...] = ()
    """Of which data are mixed that change from call to call."""

    @cached_property
    def yardstick(self) -> float:
        """What a cost gap is divided by: V* + c, a sum of squares; for a program of others max(½ x*ᵀP x*, |qᵀx*|), or
        ``cost_unit`` if that is 0."""
        x = np.array(self.certificate.x)
        if self.cost_unit == 0.0:
            return self.certificate.value_rounded + self.c
        return max(0.5 * float(x @ (self.qp.P @ x)), abs(float(self.qp.q @ x))) or self.cost_unit

    @property
    def unit(self) -> float:
        """The cost that tolerances are multiples of, known from the data alone."""
        return self.c if self.cost_unit == 0.0 else max(abs(self.c), self.cost_unit)

    @property
    def size(self) -> float:
        """‖x*‖∞, to which a violation is relative; 1 where it is 0."""
        return max((abs(entry) for entry in self.certificate.x), default=0.0) or 1.0

    @property
    def optimum_is_unique(self) -> bool:
        """Whether the data themselves single out one optimum; a shift that made them convex does not count."""
        return self.certificate.unique and self.certificate.convexity_shift == 0.0


@dataclass(frozen=True)
class Validation:
    """Data that the fit has not seen: they follow the fitted data on the same actuator, whose states are handed on."""

    structure: ModelStructure
    state: OperatorState
    x: Vector
    y: Vector
    noise_um: float = float("nan")
    """Standard deviation of the sensor's noise; what the stage notices is known where it is above zero."""

    def error_percent(self, w: Vector) -> float:
        """RMS error of the model with weights w, as a share of the output's range; NaN where w is not a valid model."""
        try:
            model = HysteresisCreepModel.from_weights(self.structure, w)
        except ValueError:
            return float("nan")
        error = model.simulate(self.x, self.state.copy()) - self.y
        return float(100.0 * np.sqrt(np.mean(error**2)) / np.ptp(self.y))

    @property
    def span_um(self) -> float:
        """Range of the output."""
        return float(np.ptp(self.y))


@dataclass(frozen=True, eq=False)
class RaceProblem:
    """A problem as it is raced."""

    set_name: str
    name: str
    forms: dict[Scaling, CertifiedForm]
    """By scaling, "scaled" and "raw"."""
    validation: Validation | None = None
    """Unseen data, for problems that come from an actuator."""

    @property
    def d(self) -> int:
        """Number of variables."""
        return int(next(iter(self.forms.values())).qp.q.shape[0])

    @cached_property
    def optimal_weights(self) -> Vector:
        """The certified optimum in weight coordinates and unit amplitudes."""
        form = next(iter(self.forms.values()))
        return np.asarray(form.to_weights @ np.array(form.certificate.x), dtype=np.float64)

    @cached_property
    def optimum_error_percent(self) -> float:
        """Error of the model of the optimum on the unseen data, NaN where there are none."""
        return math.nan if self.validation is None else self.validation.error_percent(self.optimal_weights)

    @cached_property
    def condition(self) -> float:
        """Condition number of the first form's P; infinite where rounding hides the smallest eigenvalue."""
        P = next(iter(self.forms.values())).qp.P
        values = np.linalg.eigvalsh(P if isinstance(P, np.ndarray) else P.toarray())
        hidden = values[0] <= self.d * np.finfo(float).eps * values[-1]
        return float("inf") if hidden else float(values[-1] / values[0])

    def save(self, path: Path, proven: bool = True) -> None:
        """Write everything as NPZ, whole or not at all; on request without the proofs, which are then made again on
        loading."""
        arrays: dict[str, Any] = {}
        meta: dict[str, Any] = {"set": self.set_name, "name": self.name, "certificates": {}, "c": {}, "cost_unit": {}}
        for scaling, form in self.forms.items():
            arrays |= packed_program(form.qp, f"{scaling}/")
            arrays |= packed(f"{scaling}/to_weights", form.to_weights) | packed(
                f"{scaling}/warm_start", form.warm_start
            )
            if form.windows:
                arrays |= {
                    f"{scaling}/windows/P": np.array([window.P for window in form.windows]),
                    f"{scaling}/windows/q": np.array([window.q for window in form.windows]),
                    f"{scaling}/windows/c": np.array([window.c for window in form.windows]),
                }
            meta["certificates"][scaling] = form.certificate.to_json() if proven else ""
            meta["c"][scaling], meta["cost_unit"][scaling] = form.c, form.cost_unit
        if self.validation is not None:
            v = self.validation
            meta |= {"structure": v.structure.to_dict(), **({} if math.isnan(v.noise_um) else {"noise_um": v.noise_um})}
            arrays |= {
                "validation/play": v.state.play,
                "validation/creep": v.state.creep,
                "validation/x": v.x,
                "validation/y": v.y,
            }
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, meta=np.array(json.dumps(meta)), **arrays)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what :meth:`save` wrote; ProblemFileError says what is wrong with the file."""
        with opened(path) as data:
            meta = decoded(str(data["meta"]), Meta)
            forms: dict[Scaling, CertifiedForm] = {}
            for scaling, text in meta["certificates"].items():
                qp = unpacked_program(data, f"{scaling}/")
                proof = Certificate.from_json(text) if text else certify(qp, starting_point(qp))
                forms[scaling] = CertifiedForm(
                    qp,
                    meta["c"][scaling],
                    unpacked(data, f"{scaling}/to_weights"),
                    proof,
                    unpacked(data, f"{scaling}/warm_start"),
                    meta.get("cost_unit", {}).get(scaling, 0.0),
                    _windows(data, f"{scaling}/windows/"),
                )
            if not forms:
                raise ProblemFileError(f"{path}: holds no certificate")
            validation = None
            if "structure" in meta:
                play, creep, x, y = (doubles(name, data[f"validation/{name}"]) for name in ("play", "creep", "x", "y"))
                state = OperatorState(play, creep)
                state.require(meta["structure"])
                validation = Validation(meta["structure"], state, x, y, meta.get("noise_um", math.nan))
        return cls(meta["set"], meta["name"], forms, validation)


def _windows(data: Any, prefix: str) -> tuple[Window, ...]:
    if f"{prefix}P" not in data.files:
        return ()
    return tuple(Window(P, q, float(c)) for P, q, c in zip(*(data[f"{prefix}{name}"] for name in "Pqc"), strict=True))


def starting_point(qp: Problem) -> Vector:
    """An answer (d,) from which a proof starts, or zeros."""
    dense = qp.G is None and qp.A is None and isinstance(qp.P, np.ndarray)
    start = qpsolvers.solve_problem(qp, solver="daqp").x if dense else None
    return np.zeros(qp.q.size) if start is None else start


def certified(
    set_name: str,
    name: str,
    problem: IdentificationProblem,
    validation: Validation | None = None,
    before: Vector | None = None,
    neighbours: Sequence[IdentificationProblem] = (),
) -> RaceProblem:
    """Prove the optimum of an identification in both scalings, in slope coordinates.

    The ``neighbours`` are those of other windows of the same data.

    Where the optimal weights ``before`` (d,) of the problem before this one are given, both forms carry them as a start
    in their own variables, feasible to the last bit.
    """
    forms: dict[Scaling, CertifiedForm] = {}
    for scaling in SCALINGS:
        form = problem.form("slope", scaling)
        others = [neighbour.form("slope", scaling, like=problem) for neighbour in neighbours]
        forms[scaling] = CertifiedForm(
            form.qp,
            form.c,
            form.to_weights,
            certify(form.qp, starting_point(form.qp)),
            None if before is None else np.maximum(form.variables(before), form.qp.lb),
            windows=tuple(Window(other.qp.P, other.qp.q, other.c) for other in others),
        )
    return RaceProblem(set_name, name, forms, validation)


class Meta(TypedDict):
    """What :meth:`RaceProblem.save` keeps beside the arrays."""

    set: FileName
    name: FileName
    certificates: dict[Scaling, str]
    c: dict[Scaling, float]
    cost_unit: NotRequired[dict[Scaling, float]]
    structure: NotRequired[ModelStructure]
    noise_um: NotRequired[float]


class ProblemSet(ABC):
    """A family of problems; one class a file of this folder, whose name is the set's.

    Parameters
    ----------
    seed : int
        Everything random in the set follows from it.
    **options
        Text under the names of ``needs`` and ``takes``.

    Attributes
    ----------
    left_out : dict of str to str
        Problems that are not raced and why, by name; complete once :meth:`problems` has come to its end.

    Raises
    ------
    ProblemSetError
        An option is missing, or does not make a set.
    """

    name: ClassVar[str]
    description: ClassVar[str]
    """One sentence that says what the set is for."""
    needs: ClassVar[Mapping[str, str]] = {}
    """Options that the set cannot be made without: what each is, by name."""
    takes: ClassVar[Mapping[str, str]] = {}
    """Options that may be left out."""
    origin: ClassVar[Literal["simulated", "measured elsewhere", "a recording of yours"]] = "simulated"
    """Where the data of its problems come from."""

    def __init__(self, seed: int = 0, **options: str) -> None:
        for option, what in self.needs.items():
            if option not in options:
                raise ProblemSetError(f"the problem set {self.name!r} needs --{option.replace('_', '-')}, {what}")
        self.seed = seed
        self.options = options
        self.left_out: dict[str, str] = {}

    @abstractmethod
    def __len__(self) -> int:
        """Number of problems."""

    @abstractmethod
    def problems(self) -> Iterator[RaceProblem]:
        """Make the problems one by one, each with its certified optimum."""

    def model(self) -> tuple[HysteresisCreepModel, float] | None:
        """Of a set that is one recording, what ``identify`` makes of the part that is fitted, and its error on the rest
        in per cent.

        Raises
        ------
        IdentificationError
            The recording gives no model.
        """
        return None
