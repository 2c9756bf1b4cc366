"""A problem with its certified optimum in each scaling, and the interface of a problem set."""

import hashlib
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NotRequired, Self, TypedDict

import msgspec
import numpy as np
from qpsolvers import Problem

from bench.problem_files.npz import opened, packed, packed_program, unpacked, unpacked_program
from bench.problem_files.program import doubles
from bench.problems import proofs
from bench.timing.schedule import PERIOD_US
from piezo_model import HysteresisCreepModel, IdentificationProblem, ModelStructure, OperatorState
from piezo_model.atomic_file import replacing
from piezo_model.checks import check
from piezo_model.identification_problem import Scaling
from piezo_model.json_file import FileName, decoded
from solvers.arrays import Matrix, Vector, product
from solvers.certificate import Certificate, NotCertified, verify

SCALINGS: tuple[Scaling, ...] = ("scaled", "raw")
STARTS = ("line", "warm")


class ProblemSetError(ValueError):
    """A problem set cannot be made; the message is one sentence."""


@dataclass(frozen=True)
class Window:
    """The cost of a program with the same constraints, from a neighbouring window of the same data."""

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
    starts: Mapping[str, Vector] = field(default_factory=dict)
    """Where a solve may start, each of shape (d,) in the variables z: for a model ``line``, the straight line through
    the ranges; in a sequence of problems ``warm``, the optimum of the previous one."""
    cost_unit: float = 0.0
    """Unit of the raw program's cost, for a foreign program, whose constant has no meaning; 0 if V + c is a sum of
    squares."""
    windows: tuple[Window, ...] = ()
    """Neighbouring windows; mixtures with them give data that change from call to call."""

    @cached_property
    def yardstick(self) -> float:
        """The divisor of relative cost gaps: V* + c, a sum of squares; for a foreign program max(½ x*ᵀP x*, |qᵀx*|), or
        ``cost_unit`` if that is 0."""
        x = np.array(self.certificate.x)
        if self.cost_unit == 0.0:
            return self.certificate.value_rounded + self.c
        curvature, slope = product(np.vstack([product(self.qp.P, x), self.qp.q]), x).tolist()
        return max(0.5 * curvature, abs(slope)) or self.cost_unit

    @property
    def unit(self) -> float:
        """The unit of absolute tolerances, known from the data alone."""
        return self.c if self.cost_unit == 0.0 else max(abs(self.c), self.cost_unit)

    @property
    def size(self) -> float:
        """The divisor of relative violations: ‖x*‖∞, or 1 if that is 0."""
        return max((abs(entry) for entry in self.certificate.x), default=0.0) or 1.0

    @property
    def optimum_is_unique(self) -> bool:
        """Whether the data have one optimum without a convexity shift."""
        return self.certificate.unique is True and self.certificate.convexity_shift == 0.0

    @cached_property
    def condition(self) -> float:
        """Condition number of P; infinite if the smallest eigenvalue is below the rounding errors."""
        P = self.qp.P if isinstance(self.qp.P, np.ndarray) else self.qp.P.toarray()
        values = np.linalg.eigvalsh(P)
        definite = values[0] > len(P) * np.finfo(float).eps * values[-1]
        return float(values[-1] / values[0]) if definite else math.inf


@dataclass(frozen=True)
class Validation:
    """Unseen data: they follow the fitted data on the same actuator, and start from its operator states."""

    structure: ModelStructure
    state: OperatorState
    x: Vector
    y: Vector
    """Input and output; a missing output is NaN."""
    noise_um: float = float("nan")
    """Standard deviation of the sensor's noise; 0 or NaN if it is unknown."""

    def error_percent(self, w: Vector) -> float:
        """RMS error of the model with weights w, in percent of the output's range; NaN if w is not a valid model."""
        try:
            model = HysteresisCreepModel.from_weights(self.structure, w)
        except ValueError:
            return float("nan")
        error = model.simulate(self.x, self.state) - self.y
        return float(100.0 * np.sqrt(np.nanmean(error**2)) / self.span_um)

    @property
    def span_um(self) -> float:
        """Range of the output."""
        return float(np.nanmax(self.y) - np.nanmin(self.y))


@dataclass(frozen=True, eq=False)
class RaceProblem:
    """A problem of a race."""

    set_name: str
    name: str
    forms: dict[Scaling, CertifiedForm]
    """By scaling, "scaled" and "raw"."""
    validation: Validation | None = None
    """Unseen data, for the problem of an actuator."""
    sense: float = 1.0
    """−1 if the file of the program maximises the negative of its cost."""

    @property
    def optimum(self) -> float:
        """The optimal value of the objective in the terms of its source, constant and sense included: the exact number
        rounded once."""
        form = self.forms["raw" if "raw" in self.forms else next(iter(self.forms))]
        return self.sense * float(Fraction(form.certificate.value) + Fraction(form.c))

    @property
    def d(self) -> int:
        """Number of variables."""
        return int(next(iter(self.forms.values())).qp.q.shape[0])

    @property
    def period_us(self) -> float:
        """Sampling period of its data, µs; the paper's for a program without an actuator."""
        return 1e6 * self.validation.structure.sample_time if self.validation else PERIOD_US

    @cached_property
    def digest(self) -> str:
        """Digest of the programs in every scaling."""
        hasher = hashlib.sha256()
        for scaling, form in sorted(self.forms.items()):
            hasher.update(f"{scaling} {form.c!r}".encode())
            for name, value in sorted(packed_program(form.qp, "").items()):
                hasher.update(f" {name} {value.shape}".encode() + value.tobytes())
        return hasher.hexdigest()[:16]

    @cached_property
    def optimal_weights(self) -> Vector:
        """The certified optimum in weight coordinates and normalised units."""
        form = next(iter(self.forms.values()))
        return product(form.to_weights, np.array(form.certificate.x))

    @cached_property
    def optimum_error_percent(self) -> float:
        """Error of the optimal model on the unseen data, NaN without any."""
        return math.nan if self.validation is None else self.validation.error_percent(self.optimal_weights)

    def wrong_proofs(self) -> dict[Scaling, str]:
        """The proofs replayed in exact arithmetic: what is wrong with each that does not hold, by scaling."""
        wrong: dict[Scaling, str] = {}
        for scaling, form in self.forms.items():
            try:
                verify(form.qp, form.certificate)
            except (NotCertified, ValueError) as error:
                wrong[scaling] = str(error)
        return wrong

    def save(self, path: Path, proven: bool = True) -> None:
        """Write the problem as NPZ, atomically; without ``proven`` the proofs are left out and found again on
        loading."""
        arrays: dict[str, Any] = {}
        meta: dict[str, Any] = {
            "set": self.set_name,
            "name": self.name,
            "certificates": {s: form.certificate.to_json() if proven else "" for s, form in self.forms.items()},
            "c": {s: form.c for s, form in self.forms.items()},
            "cost_unit": {s: form.cost_unit for s, form in self.forms.items()},
            **({} if self.sense == 1.0 else {"sense": int(self.sense)}),
        }
        for scaling, form in self.forms.items():
            arrays |= {
                **packed_program(form.qp, f"{scaling}/"),
                **packed(f"{scaling}/to_weights", form.to_weights),
                **{f"{scaling}/{name}_start": start for name, start in form.starts.items()},
                **{
                    f"{scaling}/windows/{name}": np.array([getattr(window, name) for window in form.windows])
                    for name in "Pqc"
                    if form.windows
                },
            }
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
        """Read a file of :meth:`save`; ProblemFileError for an invalid file."""
        with opened(path) as data:
            meta = decoded(str(data["meta"]), Meta)
            forms: dict[Scaling, CertifiedForm] = {}
            for scaling, text in meta["certificates"].items():
                qp, starts = unpacked_program(data, f"{scaling}/"), {f"{scaling}/{name}_start": name for name in STARTS}
                windows = [data[f"{scaling}/windows/{name}"] for name in "Pqc" if f"{scaling}/windows/P" in data.files]
                forms[scaling] = CertifiedForm(
                    qp,
                    meta["c"][scaling],
                    unpacked(data, f"{scaling}/to_weights"),
                    Certificate.from_json(text) if text else proofs.proof(qp),
                    {name: unpacked(data, key) for key, name in starts.items() if key in data},
                    meta.get("cost_unit", {}).get(scaling, 0.0),
                    tuple(Window(P, q, float(c)) for P, q, c in zip(*windows, strict=True)),
                )
            check(forms, "holds no certificate")
            validation = None
            if "structure" in meta:
                play, creep, x, y = (doubles(name, data[f"validation/{name}"]) for name in ("play", "creep", "x", "y"))
                state = OperatorState(play, creep)
                state.check_fits(meta["structure"])
                validation = Validation(meta["structure"], state, x, y, meta.get("noise_um", math.nan))
        return cls(meta["set"], meta["name"], forms, validation, meta.get("sense", 1.0))


def certified(
    set_name: str,
    name: str,
    problem: IdentificationProblem,
    validation: Validation | None = None,
    before: Vector | None = None,
    neighbours: Sequence[IdentificationProblem] = (),
) -> RaceProblem:
    """Certify the optimum of an identification in both scalings, in slope coordinates.

    ``neighbours`` are the problems of other windows of the same data. ``before`` (d,), the optimal weights of the
    previous problem, becomes the warm start of both forms, in their own variables and exactly feasible; so does the
    straight line.
    """
    starts = {"line": problem.structure.straight_line, **({} if before is None else {"warm": before})}
    forms: dict[Scaling, CertifiedForm] = {}
    for scaling in SCALINGS:
        form = problem.form("slope", scaling)
        others = [neighbour.form("slope", scaling, like=problem) for neighbour in neighbours]
        forms[scaling] = CertifiedForm(
            form.qp,
            form.c,
            form.to_weights,
            proofs.proof(form.qp),
            {name: np.maximum(form.variables(w), form.qp.lb) for name, w in starts.items()},
            windows=tuple(Window(other.qp.P, other.qp.q, other.c) for other in others),
        )
    return RaceProblem(set_name, name, forms, validation)


class Meta(TypedDict):
    """Metadata that :meth:`RaceProblem.save` writes beside the arrays."""

    set: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z][A-Za-z0-9_]*\Z", max_length=100)]
    """It becomes part of the code of a test set."""
    name: FileName
    certificates: dict[Scaling, str]
    c: dict[Scaling, float]
    cost_unit: NotRequired[dict[Scaling, float]]
    structure: NotRequired[ModelStructure]
    noise_um: NotRequired[float]
    sense: NotRequired[Literal[-1, 1]]


class ProblemSet(ABC):
    """A family of problems.

    Parameters
    ----------
    seed : int
        Seed of everything random in the set.
    **options
        Texts by the names of ``needs`` and ``takes``.

    Attributes
    ----------
    left_out : dict of str to str
        Problems that are not raced, with the reason; complete when :meth:`problems` is exhausted.
    selected : set of str
        Names of the problems to make; all by default. :meth:`problems` may skip the others.

    Raises
    ------
    ProblemSetError
        An option is missing or invalid.
    """

    name: ClassVar[str]
    description: ClassVar[str]
    """Purpose of the set, one sentence."""
    needs: ClassVar[Mapping[str, str]] = {}
    """Required options: name and description."""
    takes: ClassVar[Mapping[str, str]] = {}
    """Optional options: name and description."""
    origin: ClassVar[Literal["simulated", "measured elsewhere", "a recording of yours"]] = "simulated"
    """Source of the data."""

    def __init__(self, seed: int = 0, **options: str) -> None:
        for option, what in self.needs.items():
            check(
                option in options,
                f"the problem set {self.name!r} needs --{option.replace('_', '-')}, {what}",
                ProblemSetError,
            )
        self.seed = seed
        self.options = options
        self.left_out: dict[str, str] = {}

    @abstractmethod
    def names(self) -> Sequence[str]:
        """Names of the problems, in their order."""

    @cached_property
    def selected(self) -> Set[str]:
        """All names."""
        return {*self.names()}

    @abstractmethod
    def problems(self) -> Iterator[RaceProblem]:
        """Make the problems one by one, each with its certified optimum."""

    def model(self) -> tuple[HysteresisCreepModel, float] | None:
        """For a set made of one recording, the model that ``identify`` fits to it, and in percent the error on the last
        fifth of one that it fits to the rest.

        Raises
        ------
        IdentificationError
            The recording gives no model.
        """
        return None

    def digests(self) -> dict[str, str]:
        """For a set made of one recording, by the digest of fitted data: whether its last fifth was held out."""
        return {}
