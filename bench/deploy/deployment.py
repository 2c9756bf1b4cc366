"""The file of a decision: model, solver and settings of a controller, with the evidence for the choice."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec

from bench.messages.task import Tier
from piezo_model import SelfLearningCompensator, checks, json_file
from piezo_model.json_file import Number
from piezo_model.learning.settings import LearningSettings, Mode
from piezo_model.model import HysteresisCreepModel, ModelError, ModelFile
from solvers import Lane
from solvers.protocol import setting_text

Model = TypeVar("Model", HysteresisCreepModel, ModelFile)


class Deployment(json_file.Versioned, Generic[Model], kw_only=True):
    """Start of a self-learning compensator; in a file the model is a :class:`ModelFile`."""

    FORMAT = "piezobench-compensator"
    VERSION = 3
    UPGRADE_HINT = "deploy again"
    format: str = FORMAT
    version: int = VERSION
    model: Model
    solver: str
    lane: Lane
    """Name of the solver for ``solvers.get``."""
    tier: Tier
    """Accuracy that its answers reached."""
    settings: dict[str, Any]
    """A rung of the solver's ladder for a problem with the constant c = 1; other problems scale it by their own c."""
    mode: Mode
    x_limits: tuple[Number, Number]
    """Limits of the drive in the input unit."""
    evidence: dict[str, Any] = msgspec.field(default_factory=dict)
    """Run, machine, rule, figures and certificate, for people to read."""

    def __post_init__(self) -> None:
        self.lane, self.tier = Lane(self.lane), Tier(self.tier)
        self.x_limits = LearningSettings(**self.learning).x_limits  # type: ignore[assignment]

    @property
    def learning(self) -> dict[str, Any]:
        """Its settings of a learner, as of `LearningSettings`."""
        options = {"lane": self.lane, "setting": setting_text(self.settings)}
        return {"solver": self.solver, "x_limits": self.x_limits, "mode": self.mode, "solver_options": options}

    def learner(self: Deployment[HysteresisCreepModel], **options: Any) -> SelfLearningCompensator:
        """A compensator that starts from it; the options of the class override those of the file."""
        return SelfLearningCompensator(self.model.structure, **{"model": self.model, **self.learning, **options})

    def save(self: Deployment[HysteresisCreepModel], path: str | Path) -> None:
        """Write JSON; the file is replaced as a whole."""
        data = {**msgspec.structs.asdict(self), "model": self.model.to_dict()}
        json_file.write(path, data, ModelError)

    @classmethod
    def load(cls, path: str | Path) -> Deployment[HysteresisCreepModel]:
        """Read a file of :meth:`save`; ModelError names the file and what is wrong with it."""
        file = json_file.read(path, Deployment[ModelFile], ModelError)
        with checks.refusing(ModelError, f"{path}: its model is not valid: "):
            model = HysteresisCreepModel.from_file(file.model)
        return Deployment(**{**msgspec.structs.asdict(file), "model": model})


def open_model(path: str | Path) -> tuple[HysteresisCreepModel, Deployment[HysteresisCreepModel] | None]:
    """The model in a file of ``identify`` or ``deploy``, and the deployment if it is one; ModelError as of both."""
    if json_file.format_of(path) == Deployment.FORMAT:
        deployed = Deployment.load(path)
        return deployed.model, deployed
    return HysteresisCreepModel.load(path), None
