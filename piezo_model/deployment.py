"""The files from which a self-learning compensator starts: a deployment, or its own when it was saved in operation, as
which a bank is saved, too.

A deployment for a controller holds model, solver and settings, with the evidence for the choice; ``piezobench deploy``
writes it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec

from piezo_model import checks, json_file
from piezo_model.atomic_file import write_text
from piezo_model.json_file import Number, packed, unpacked
from piezo_model.learning.settings import LearningSettings, Mode
from piezo_model.model import HysteresisCreepModel, ModelError, ModelFile
from solvers import Lane
from solvers.protocol import setting_text

TIERS = ("default", "low", "mid", "high", "exact")
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
    tier: str
    """Accuracy that its answers reached, one of TIERS."""
    settings: dict[str, Any]
    """A rung of the solver's ladder for a problem with the constant c = 1; other problems scale it by their own c."""
    mode: Mode
    x_limits: tuple[Number, Number]
    """Limits of the drive in the input unit."""
    evidence: dict[str, Any] = msgspec.field(default_factory=dict)
    """Run, machine, rule, figures and certificate, for people to read."""

    def __post_init__(self) -> None:
        self.lane = Lane(self.lane)
        checks.one_of(TIERS, tier=self.tier)
        self.x_limits = LearningSettings(  # type: ignore[assignment]
            solver=self.solver, x_limits=self.x_limits, mode=self.mode, solver_options=self.options
        ).x_limits

    @property
    def options(self) -> dict[str, Any]:
        """Lane and setting of the solver as of `LearningSettings`."""
        return {"lane": self.lane, "setting": setting_text(self.settings)}

    def save(self: Deployment[HysteresisCreepModel], path: str | Path) -> None:
        """Write JSON; the file is replaced as a whole."""
        data = {**msgspec.structs.asdict(self), "model": self.model.to_dict()}
        with checks.refusing(ModelError, f"{path}: cannot be written: "):
            write_text(path, json.dumps(packed(data), indent=1) + "\n")

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


class LearnerFile(json_file.Versioned):
    """The file of a self-learning compensator, or of a bank of them, in operation: arrays are packed, to the bit."""

    FORMAT = "piezobench-learner"
    VERSION = 9
    UPGRADE_HINT = "save a learner's model, its field state.compensator.model, as a file, and start from that"
    settings: dict[str, Any]
    """Fields of `learning.settings.LearningSettings`, or of `bank.BankSettings`."""
    state: dict[str, Any]
    """With the model and its structure, or of a bank."""
    checksum: str
    """SHA-256 of the rest."""


def _checksum(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode("utf-8")).hexdigest()


def write_learner(path: str | Path, settings: Mapping[str, Any], state: Mapping[str, Any]) -> None:
    """Write a compensator in operation; the file is replaced as a whole."""
    content = {
        "format": LearnerFile.FORMAT,
        "version": LearnerFile.VERSION,
        "settings": packed(settings),
        "state": packed(state),
    }
    write_text(path, json.dumps({**content, "checksum": _checksum(content)}, indent=1, allow_nan=False) + "\n")


def read_learner(path: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Settings and state; ModelError names what is wrong with the file."""
    content = msgspec.structs.asdict(json_file.read(path, LearnerFile, ModelError))
    if content.pop("checksum") != _checksum(content):
        raise ModelError(f"{path}: is damaged, since its checksum is another one")
    with checks.refusing(ModelError, f"{path}: holds a broken array: "):
        return unpacked(content["settings"]), unpacked(content["state"])
