"""A decision that can be carried to a controller: model, solver and settings in one file, with the evidence for them.

``piezobench deploy`` writes it and ``SelfLearningCompensator.load`` starts from it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from piezo_model.atomic_file import write_text
from piezo_model.model import HysteresisCreepModel, ModelError
from piezo_model.structure import StructureError

FORMAT = "piezobench-compensator"
VERSION = 2
MODES = ("cyclic", "continuous")


@dataclass(frozen=True)
class Deployment:
    """What a self-learning compensator starts from.

    Attributes
    ----------
    model : HysteresisCreepModel
    solver, lane : str
        As of ``solvers.get``.
    tier : str
        What its answers reached.
    settings : mapping
        The solver's own, or its rung.
    mode : "cyclic" or "continuous"
    x_limits : pair of float
        Limits of the drive in the input unit.
    evidence : mapping
        Run, machine, rule, figures and certificate; kept for people, not acted on.
    """

    model: HysteresisCreepModel
    solver: str
    lane: str
    tier: str
    settings: Mapping[str, Any]
    mode: str
    x_limits: tuple[float, float]
    evidence: Mapping[str, Any] = field(default_factory=dict)

    def save(self, path: str | Path) -> None:
        """Write it as JSON, whole or not at all."""
        data = {"format": FORMAT, "version": VERSION, "solver": self.solver, "lane": self.lane, "tier": self.tier,
                "settings": dict(self.settings), "mode": self.mode, "x_limits": list(self.x_limits),
                "model": self.model.to_dict(), "evidence": dict(self.evidence)}
        write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")

    @classmethod
    def load(cls, path: str | Path) -> Deployment:
        """Read what :meth:`save` wrote; ModelError names the file and what is wrong with it."""
        try:
            data = json.loads(Path(path).read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise ModelError(f"{path}: there is no such file") from None
        except OSError as error:
            raise ModelError(f"{path}: cannot be read ({error.strerror})") from None
        except (json.JSONDecodeError, UnicodeDecodeError) as error:
            raise ModelError(f"{path}: is not a whole JSON file ({error})") from None
        if (wrong := _wrong(data)) is not None:
            raise ModelError(f"{path}: is not a compensator: {wrong}")
        try:
            model = HysteresisCreepModel.from_dict(data["model"])
        except (ModelError, StructureError) as error:
            raise ModelError(f"{path}: its model is not valid: {error}") from None
        low, high = data["x_limits"]
        return cls(model, data["solver"], data["lane"], data["tier"], data["settings"], data["mode"],
                   (float(low), float(high)), data.get("evidence", {}))


def _wrong(data: Any) -> str | None:
    """The first thing that is wrong with the fields, in words."""
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        return f"the format field is not {FORMAT!r}"
    if data.get("version") != VERSION:
        return f"version {data.get('version')!r} is not {VERSION}, the one this program reads"
    for name, kind in (("solver", str), ("lane", str), ("tier", str), ("settings", dict), ("mode", str), ("x_limits", list)):
        if not isinstance(data.get(name), kind):
            return f"the field {name!r} is missing or of the wrong type"
    if data["mode"] not in MODES:
        return f"the mode is {data['mode']!r} and neither of {' and '.join(MODES)}"
    limits = data["x_limits"]
    if len(limits) != 2 or not all(type(limit) in (int, float) for limit in limits) or not limits[0] < limits[1]:
        return f"x_limits must be two numbers in ascending order, not {limits}"
    return None if "model" in data else "the field 'model' is missing"
