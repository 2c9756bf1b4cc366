"""Identification as the command line asks for it, of one recording or of each of a fleet."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.messages.progress import Progress, silent
from piezo_model import HysteresisCreepModel, Recording, identify
from piezo_model.identification.fit_review import review
from piezo_model.identification.identify import LagChoice, check_direction
from piezo_model.recordings.recording import HELD


@dataclass(frozen=True)
class Identifying:
    """Settings of `identify`, and keywords of ``Recording.open``; what is None of orders and rates is chosen from the
    recording."""

    opening: Mapping[str, Any] = field(default_factory=dict)
    n: int | None = None
    m: int | None = None
    creep_rates: tuple[float, ...] | None = None
    skip: int | None = None
    lag: LagChoice = "estimate"
    solver: str = "box_active_set"
    force: bool = False
    made = "{}.json"

    def reads(self, name: str) -> Sequence[str]:
        """Nothing but the recording."""
        return ()

    def do(self, recording: Path, further: Sequence[Path], target: Path) -> dict[str, Any]:
        """Write the model; returns figures of the fit, and the weights in unit amplitudes."""
        model = self.of(self.opened(recording))
        model.save(target)
        s, fit = model.structure, model.report["fit"]
        figures = {
            name: fit[name]
            for name in ("rms_percent", "max_percent", "line_percent", "rms", "max", "samples", "skipped")
        }
        return {
            **figures,
            "forced": model.warning,
            "output_unit": s.output_unit,
            "sample_time_s": s.sample_time,
            "n": s.n,
            "m": s.dead_zones // 2,
            **{name: float(value) for name, value in zip(s.weight_names, model.weights, strict=True)},
        }

    def draw(self, recording: Path, further: Sequence[Path], made: Path, page: Path) -> None:
        """Write the page that identify writes of one recording."""
        from bench.report import recording_page  # plots take a second to import, and most workers draw none

        recording_page.write(page, recording.name, review(self.opened(recording), HysteresisCreepModel.load(made)))

    def opened(self, recording: Path) -> Recording:
        """The recording; which column is the input is settled by a fit where their names do not say it."""
        return check_direction(Recording.open(recording, hold=HELD, **self.opening))

    def of(self, recording: Recording, progress: Progress = silent) -> HysteresisCreepModel:
        """The model of a recording."""
        return identify(
            recording,
            n=self.n,
            m=self.m,
            creep_rates=self.creep_rates,
            skip=self.skip,
            lag=self.lag,
            solver=self.solver,
            force=self.force,
            progress=progress,
        )
