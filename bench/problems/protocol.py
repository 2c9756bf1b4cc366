"""A problem that owns its certified optimum, in each scaling in which it is raced."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import qpsolvers
from numpy.typing import NDArray
from qpsolvers import Problem

from piezo_model import HysteresisCreepModel, IdentificationProblem, ModelStructure, OperatorState
from piezo_model.atomic_file import replacing
from piezo_model.identification_problem import Scaling
from solvers.certificate import Certificate, certify

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

SCALINGS: tuple[Scaling, ...] = ("scaled", "raw")
QP_FIELDS = ("P", "q", "G", "h", "A", "b", "lb", "ub")


@dataclass(frozen=True)
class CertifiedForm:
    """One scaling of a problem: the program in z, the weights w = ``to_weights`` z, and the proof of its optimum."""

    qp: Problem
    c: float
    to_weights: Matrix
    certificate: Certificate


@dataclass(frozen=True)
class Validation:
    """Data that the fit has not seen: they follow the fitted data on the same actuator, whose states are handed on."""

    structure: ModelStructure
    state: OperatorState
    x: Vector
    y: Vector
    noise_um: float = float("nan")
    """Standard deviation of the sensor's noise."""

    def error_percent(self, w: Vector) -> float:
        """RMS error of the model with weights w, as a share of the output's range; NaN where w is no valid model."""
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
    """A problem as it is raced.

    Attributes
    ----------
    set_name, name : str
    forms : dict
        By scaling, "scaled" and "raw".
    validation : Validation, optional
        Unseen data, for problems that come from an actuator.
    """

    set_name: str
    name: str
    forms: dict[Scaling, CertifiedForm]
    validation: Validation | None = None

    @property
    def d(self) -> int:
        """Number of variables."""
        return int(next(iter(self.forms.values())).qp.q.shape[0])

    @cached_property
    def optimal_weights(self) -> Vector:
        """The certified optimum in weight coordinates and unit amplitudes."""
        form = next(iter(self.forms.values()))
        return form.to_weights @ np.array(form.certificate.x)

    def save(self, path: Path) -> None:
        """Write everything as NPZ, whole or not at all."""
        arrays: dict[str, Any] = {}
        meta: dict[str, Any] = {"set": self.set_name, "name": self.name, "certificates": {}, "c": {}}
        for scaling, form in self.forms.items():
            for field in QP_FIELDS:
                value = getattr(form.qp, field)
                if value is not None:
                    arrays[f"{scaling}/{field}"] = value
            arrays[f"{scaling}/to_weights"] = form.to_weights
            meta["certificates"][scaling] = form.certificate.to_json()
            meta["c"][scaling] = form.c
        if self.validation is not None:
            v = self.validation
            meta |= {"structure": v.structure.to_dict(), "noise_um": v.noise_um}
            arrays |= {"validation/play": v.state.play, "validation/creep": v.state.creep, "validation/x": v.x,
                       "validation/y": v.y}
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, meta=np.array(json.dumps(meta)), **arrays)

    @classmethod
    def load(cls, path: Path) -> RaceProblem:
        """Read what :meth:`save` wrote."""
        with np.load(path, allow_pickle=False) as data:
            meta = json.loads(str(data["meta"]))
            forms = {scaling: CertifiedForm(stored_qp(data, scaling), meta["c"][scaling], data[f"{scaling}/to_weights"],
                                            Certificate.from_json(text))
                     for scaling, text in meta["certificates"].items()}
            validation = None
            if "structure" in meta:
                state = OperatorState(data["validation/play"], data["validation/creep"])
                validation = Validation(ModelStructure.from_dict(meta["structure"]), state, data["validation/x"],
                                        data["validation/y"], meta["noise_um"])
        return cls(meta["set"], meta["name"], forms, validation)


def stored_qp(data: Any, scaling: str) -> Problem:
    """The program of one scaling from an open NPZ file."""
    fields = {field: data[f"{scaling}/{field}"] for field in QP_FIELDS if f"{scaling}/{field}" in data}
    return Problem(**{"G": None, "h": None, "A": None, "b": None, "lb": None, "ub": None, **fields})


def certified(set_name: str, name: str, problem: IdentificationProblem,
              validation: Validation | None = None) -> RaceProblem:
    """Prove the optimum of an identification in both scalings, in slope coordinates."""
    forms: dict[Scaling, CertifiedForm] = {}
    for scaling in SCALINGS:
        form = problem.form("slope", scaling)
        start = qpsolvers.solve_problem(form.qp, solver="daqp").x
        forms[scaling] = CertifiedForm(form.qp, form.c, form.to_weights,
                                       certify(form.qp, np.zeros(problem.structure.d) if start is None else start))
    return RaceProblem(set_name, name, forms, validation)


class ProblemSet(ABC):
    """A family of problems; one class a file of this folder, whose name is the set's.

    Parameters
    ----------
    seed : int
        Everything random in the set follows from it.
    """

    name: ClassVar[str]
    description: ClassVar[str]
    """One sentence that says what the set is for."""

    def __init__(self, seed: int = 0) -> None:
        self.seed = seed

    @abstractmethod
    def __len__(self) -> int:
        """Number of problems."""

    @abstractmethod
    def problems(self) -> Iterator[RaceProblem]:
        """Make the problems one by one, each with its certified optimum."""
