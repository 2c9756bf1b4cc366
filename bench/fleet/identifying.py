"""Identification as the command line asks for it, of one recording or of each of a fleet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.passed.progress import Progress, silent
from piezo_model import HysteresisCreepModel, Recording, identify
from piezo_model.identification.fit_review import review
from piezo_model.identification.identify import LagChoice, check_direction
from piezo_model.identification.order_selection import OrderSelection, select_order


@dataclass(frozen=True)
class Identifying:
    """Settings of `identify`; ``select`` chooses the orders by cross-validation, and ``opening`` are keywords of ``Recording.open``."""

    opening: Mapping[str, Any] = field(default_factory=dict)
    n: int = 5
    m: int = 3
    creep_rates: tuple[float, ...] | None = None
    skip: int | None = None
    lag: LagChoice = "estimate"
    solver: str = "box_active_set"
    force: bool = False
    select: bool = False
    made = "{}.json"

    def reads(self, name: str) -> Sequence[str]:
        """Nothing but the recording."""
        return ()

    def do(self, recording: Path, further: Sequence[Path], target: Path) -> dict[str, Any]:
        """Write the model; returns figures of the fit, and the weights in unit amplitudes."""
        model, _ = self.of(self.opened(recording))
        model.save(target)
        s, fit = model.structure, model.report["fit"]
        figures = {name: fit[name] for name in ("rms_percent", "max_percent", "line_percent", "rms", "max", "samples", "skipped")}
        return {**figures, "forced": model.warning, "output_unit": s.output_unit, "sample_time_s": s.sample_time, "n": s.n, "m": s.dead_zones // 2,
                **{name: float(value) for name, value in zip(s.weight_names, model.weights, strict=True)}}

    def draw(self, recording: Path, further: Sequence[Path], made: Path, page: Path) -> None:
        """Write the page that identify writes of one recording."""
        from bench.report import recording_page  # plots take a second to import, and most workers draw none

        recording_page.write(page, recording.name, review(self.opened(recording), HysteresisCreepModel.load(made)))

    def opened(self, recording: Path) -> Recording:
        """The recording; which column is the input is settled by a fit where their names do not say it."""
        return check_direction(Recording.open(recording, **self.opening))

    def of(self, recording: Recording, progress: Progress = silent) -> tuple[HysteresisCreepModel, OrderSelection | None]:
        """The model of a recording, and what chose its orders."""
        def fitted(n: int, m: int) -> HysteresisCreepModel:
            progress(f"identifying with n = {n}, m = {m}", 0, 1 + self.select)
            return identify(recording, n=n, m=m, creep_rates=self.creep_rates, skip=self.skip, lag=self.lag, solver=self.solver, force=self.force)

        model = fitted(self.n, self.m)
        if not self.select:
            return model, None
        orders = select_order(recording, model, self.solver, progress=progress)
        return fitted(orders.chosen.n, orders.chosen.m), orders
