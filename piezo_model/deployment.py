"""A decision that can be carried to a controller: model, solver and settings in one file, with the evidence for them.

``piezobench deploy`` writes it and ``SelfLearningCompensator.load`` starts from it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from piezo_model import json_file
from piezo_model.atomic_file import write_text
from piezo_model.json_file import Number
from piezo_model.learning.settings import Mode
from piezo_model.model import HysteresisCreepModel, ModelError, ModelFile
from solvers import Lane, Tier, find


class DeploymentFile(json_file.Versioned):
    """What :meth:`Deployment.save` writes."""

    FORMAT = "piezobench-compensator"
    VERSION = 2
    solver: str
    lane: Lane
    tier: Tier
    settings: dict[str, Any]
    mode: Mode
    x_limits: tuple[Number, Number]
    model: ModelFile
    evidence: dict[str, Any] = msgspec.field(default_factory=dict)


@dataclass(frozen=True)
class Deployment:
    """What a self-learning compensator starts from."""

    model: HysteresisCreepModel
    solver: str
    lane: str
    """As of ``solvers.get``."""
    tier: str
    """What its answers reached."""
    settings: Mapping[str, Any]
    """The solver's own, or its rung."""
    mode: Mode
    x_limits: tuple[float, float]
    """Limits of the drive in the input unit."""
    evidence: Mapping[str, Any] = field(default_factory=dict)
    """Run, machine, rule, figures and certificate; kept for people, not acted on."""

    def save(self, path: str | Path) -> None:
        """Write it as JSON, whole or not at all."""
        data = {"format": DeploymentFile.FORMAT, "version": DeploymentFile.VERSION, "solver": self.solver, "lane": self.lane, "tier": self.tier,
                "settings": dict(self.settings), "mode": self.mode, "x_limits": list(self.x_limits),
                "model": self.model.to_dict(), "evidence": dict(self.evidence)}
        write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")

    @classmethod
    def load(cls, path: str | Path) -> Deployment:
        """Read what :meth:`save` wrote; ModelError names the file and what is wrong with it."""
        file = json_file.read(path, DeploymentFile, ModelError)
        try:
            model = HysteresisCreepModel.from_file(file.model)
        except ValueError as error:
            raise ModelError(f"{path}: its model is not valid: {error}") from None
        try:
            find(file.solver, file.lane)
        except KeyError as error:
            raise ModelError(f"{path}: {json_file.brief(error)}") from None
        low, high = file.x_limits
        if not low < high:
            raise ModelError(f"{path}: x_limits must be two numbers in ascending order, not {low:g} and {high:g}")
        return cls(model, file.solver, file.lane, file.tier, file.settings, file.mode, file.x_limits, file.evidence)
