"""Identification, validation and compensation with the options of the command line, of one recording or of each of a
fleet."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bench.deploy.deployment import open_model
from bench.messages.task import Progress, silent
from piezo_model import Compensator, HysteresisCreepModel, Recording, checks, identify, recordings
from piezo_model.identification.validation import Validation
from piezo_model.model import ModelError, StartChoice


class Job(ABC):
    """A processing step of one recording; subclasses are frozen dataclasses of settings, sent to workers."""

    product = ""
    """Name of the file that is written, with {} for the recording's name, or ""."""

    def reads(self, name: str) -> Sequence[Path]:
        """Paths of the other files that are read for a recording of this name."""
        return ()

    @abstractmethod
    def do(self, recording: Path, further: Sequence[Path], target: Path) -> dict[str, Any]:
        """Process a recording, write the product to the target, and return figures."""


@dataclass(frozen=True)
class Identifying(Job):
    """Keywords of ``Recording.open``, and of `identify`, which chooses orders and rates that are None."""

    opening: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    product = "{}.json"

    def do(self, recording: Path, further: Sequence[Path], target: Path) -> dict[str, Any]:
        """Write the model; return figures of the fit, and the weights in normalised units."""
        model = self.of(Recording.open(recording, **self.opening))
        model.save(target)
        s, fit = model.structure, model.report["fit"]
        return {
            **{
                name: fit[name]
                for name in ("rms_percent", "max_percent", "line_percent", "rms", "max", "samples", "skipped")
            },
            "forced": model.warning,
            "output_unit": s.output_unit,
            "sample_time_s": s.sample_time,
            "n": s.n,
            "m": s.dead_zones // 2,
            **{name: float(value) for name, value in zip(s.weight_names, model.weights, strict=True)},
        }

    def of(self, recording: Recording | Sequence[Recording], progress: Progress = silent) -> HysteresisCreepModel:
        """Identify the model of a recording, or of several of one stage."""
        return identify(recording, **self.options, progress=progress)


@dataclass(frozen=True)
class WithModel(Job):
    """Job that needs a model: ``model`` is the path of one, or of a folder with NAME.json for each recording;
    ``opening`` are keywords of ``Recording.open`` or ``read_reference``."""

    model: str
    opening: Mapping[str, Any] = field(default_factory=dict)

    def reads(self, name: str) -> Sequence[Path]:
        """Path of the model."""
        path = Path(self.model)
        return (path / f"{name}.json" if path.is_dir() else path,)


@dataclass(frozen=True)
class Validating(WithModel):
    """Validation of a model on a recording."""

    def do(self, recording: Path, further: Sequence[Path], target: Path) -> dict[str, Any]:
        """Return figures of the fit, and the constant shift of the output."""
        _, model, validation = self.judged(recording, further[0])
        fit = vars(validation.fit)
        return {
            **{name: fit[name] for name in ("rms_percent", "max_percent", "line_percent", "rms", "max", "samples")},
            "forced": model.warning,
            "shift": validation.shift,
            "units": validation.units,
            "beyond_percent": validation.beyond_percent,
            "own": validation.own,
            "output_unit": model.structure.output_unit,
        }

    def judged(self, recording: Path | None, model: Path) -> tuple[Recording, HysteresisCreepModel, Validation]:
        """The recording, the model and its validation."""
        loaded, _ = open_model(model)
        opened = Recording.open(recording, **self.opening)
        with checks.refusing(ModelError, f"{model} with {recording}: "):
            loaded = loaded.at(opened.sample_time)
        result = loaded.validate(opened)
        return opened, result.model, result


FOLLOWED = 1e-3
"""Largest error, as a share of the output's range, at which a reference counts as followed."""


@dataclass(frozen=True)
class Compensating(WithModel):
    """Drive for a reference: its limits, by default those of a deployment or the model's range, its start, and whether
    the dynamics of the model are inverted; with ``preview`` without lag, which anticipates the reference."""

    low: float | None = None
    high: float | None = None
    rate_limit: float | None = None
    start: StartChoice = "rest"
    x_start: float | None = None
    dynamics: bool = True
    preview: bool = False
    product = "{}-drive.csv"

    def do(self, recording: Path, further: Sequence[Path], target: Path) -> dict[str, Any]:
        """Write the drive; return how well the model follows the reference with it, and the share at the limits.

        The reference counts after the lag of the output. RecordingError if the limits are not ascending, or the drive
        does not start within them; ModelError if the model has not the states that it is to start with, or no dynamics
        for a preview; UnitError if the reference is in a unit that cannot be converted to the model's.
        """
        (model, deployed), read = open_model(further[0]), recordings.read_reference(recording, **self.opening)
        reference = read.suited(model.structure.output_unit)
        with checks.refusing(ModelError, f"{further[0]} with {recording}: "):
            model = model.at(read.sample_time)
        s = model.structure
        lowest, highest = deployed.x_limits if deployed else s.x_range
        limits = (lowest if self.low is None else self.low, highest if self.high is None else self.high)
        checks.check(
            limits[0] < limits[1],
            f"the lowest drive --low {limits[0]:g} must be below the highest --high {limits[1]:g}",
            recordings.RecordingError,
        )
        known = None if self.start == "rest" else model.initial_state(self.start)
        y_ref, inverted = reference.values, self.dynamics and not self.preview
        if self.preview:
            if model.dynamics is None:
                raise ModelError(f"{further[0]}: the model has no dynamics, so --preview has nothing to anticipate")
            y_ref = model.dynamics.anticipated(y_ref, s.sample_time, amplifier=True)
        with checks.refusing(recordings.RecordingError):
            compensator = Compensator(model, limits, self.rate_limit, known, x_start=self.x_start, dynamics=inverted)
        state, lag = compensator.state.copy(), compensator.lag_s
        x = compensator.run(y_ref)
        times, name = np.arange(x.size) * reference.sample_time, f"drive_{s.input_unit}".rstrip("_")
        recordings.write_table(target, {"time_s": times, name: x}, model.warning)
        late = np.interp(times - lag, times, reference.values)
        error, span = np.abs(model.simulate(x, state) - late), 2.0 * abs(s.y_scale)
        return {
            "forced": model.warning,
            "reading": read.describe(),
            "units": reference.units,
            "start": self.start,
            "lag_s": lag,
            "x_start": float(s.x_centre + s.x_scale * state.play[0]),
            "samples": x.size,
            "lowest": float(x.min()),
            "highest": float(x.max()),
            "unit": s.input_unit,
            "share_at_limits": float(np.mean((x <= limits[0]) | (x >= limits[1]))),
            "share_followed": float(np.mean(error <= FOLLOWED * span)),
            "largest_error": float(error.max()),
            "largest_error_s": float(times[np.argmax(error)]),
            "output_unit": s.output_unit,
            "rms_percent": 100.0 * float(np.sqrt(np.mean(error**2))) / span,
            "max_percent": 100.0 * float(error.max()) / span,
        }
