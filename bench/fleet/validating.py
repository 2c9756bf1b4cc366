"""Validation as the command line asks for it: of one model on each recording of a fleet, or of a fleet's models on one
recording each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from bench.fleet.storage import model_of
from piezo_model import HysteresisCreepModel, Recording
from piezo_model.identification.fit_review import review
from piezo_model.identification.identify import check_direction
from piezo_model.identification.validation import Validation
from piezo_model.recordings.recording import HELD


@dataclass(frozen=True)
class Validating:
    """``model`` is the place of a model, or of a folder with one NAME.json a recording; ``opening`` are keywords of
    ``Recording.open``."""

    model: str
    opening: Mapping[str, Any] = field(default_factory=dict)
    made = ""

    def reads(self, name: str) -> Sequence[str]:
        """The model."""
        return (model_of(self.model, name),)

    def do(self, recording: Path, further: Sequence[Path], target: Path) -> dict[str, Any]:
        """Figures of the fit, and the offset of the sensor against the session of the identification."""
        _, model, found = self.judged(recording, further[0])
        fit = asdict(found.fit)
        return {
            **{name: fit[name] for name in ("rms_percent", "max_percent", "line_percent", "rms", "max", "samples")},
            "forced": model.warning,
            "shift": found.shift,
            "beyond_percent": found.beyond_percent,
            "output_unit": model.structure.output_unit,
        }

    def draw(self, recording: Path, further: Sequence[Path], made: Path, page: Path) -> None:
        """Write the page that validate writes of one recording."""
        from bench.report import recording_page  # plots take a second to import, and most workers draw none

        recording_page.write(page, recording.name, review(*self.judged(recording, further[0])))

    def judged(self, recording: Path, model: Path) -> tuple[Recording, HysteresisCreepModel, Validation]:
        """The recording, the model and what it is worth there."""
        loaded, opened = (
            HysteresisCreepModel.load(model),
            check_direction(Recording.open(recording, hold=HELD, **self.opening)),
        )
        return opened, loaded, loaded.validate(opened)
