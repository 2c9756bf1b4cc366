"""Compensation as the command line asks for it: the drive that makes one actuator, or each of a fleet, follow a
reference."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bench.fleet.storage import model_of
from piezo_model import Compensator, HysteresisCreepModel
from piezo_model.model import StartChoice
from piezo_model.recordings import RecordingError, read_reference, write_table

FOLLOWED = 1e-3
"""Share of the output's range within which the model follows a reference."""


@dataclass(frozen=True)
class Compensating:
    """Limits of the drive, the model's range by default, the states to begin with, and keywords of ``read_reference``;
    ``model`` as in `Validating`."""

    model: str
    opening: Mapping[str, Any] = field(default_factory=dict)
    low: float | None = None
    high: float | None = None
    rate_limit: float | None = None
    start: StartChoice = "identified"
    made = "{}-drive.csv"

    def reads(self, name: str) -> Sequence[str]:
        """The model."""
        return (model_of(self.model, name),)

    def do(self, recording: Path, further: Sequence[Path], target: Path) -> dict[str, Any]:
        """Write the drive; returns how well the model follows the reference with it, and what keeps it from that.

        RecordingError where sampling or unit of the reference are not the model's, or the limits are none.
        """
        model = HysteresisCreepModel.load(further[0])
        s, wanted = model.structure, read_reference(recording, **self.opening)
        if abs(wanted.sample_time / s.sample_time - 1.0) > 0.01:
            raise RecordingError(
                f"{recording}: is sampled every {wanted.sample_time:g} s and the model every {s.sample_time:g} s"
            )
        if wanted.unit and s.output_unit and wanted.unit != s.output_unit:
            raise RecordingError(f"{recording}: is in {wanted.unit} and the model's output in {s.output_unit}")
        limits = (
            s.x_centre - s.x_scale if self.low is None else self.low,
            s.x_centre + s.x_scale if self.high is None else self.high,
        )
        if not limits[0] < limits[1]:
            raise RecordingError(f"the lowest drive --low {limits[0]:g} must be below the highest --high {limits[1]:g}")
        state = model.initial_state(self.start)
        x = Compensator(model, x_limits=limits, rate_limit=self.rate_limit, state=state).run(wanted.values)
        times, name = np.arange(x.size) * wanted.sample_time, f"drive_{s.input_unit}".rstrip("_")
        write_table(target, {"time_s": times, name: x}, model.warning)
        error, span = np.abs(model.simulate(x, state) - wanted.values), 2.0 * abs(s.y_scale)
        return {
            "forced": model.warning,
            "start": self.start if model.start is not None else "rest",
            "samples": x.size,
            "lowest": float(x.min()),
            "highest": float(x.max()),
            "unit": s.input_unit,
            "share_at_limits": float(np.mean((x <= limits[0]) | (x >= limits[1]))),
            "share_followed": float(np.mean(error <= FOLLOWED * span)),
            "largest_error": float(error.max()),
            "output_unit": s.output_unit,
            "rms_percent": 100.0 * float(np.sqrt(np.mean(error**2))) / span,
            "max_percent": 100.0 * float(error.max()) / span,
        }
