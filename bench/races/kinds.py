"""The kinds of race by name: how each is set up, started, carried on, reported and shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.processes.engine import Workers
from bench.races import anytime, closed_loop, race, stream
from bench.races.race import Progress
from bench.races.settings import RaceError, RaceSettings
from bench.report import loop_report, markdown, race_reports
from bench.report.race_reports import Report
from bench.store import ONESHOT, Run, RunError, Schema


@dataclass(frozen=True)
class Kind:
    """One kind of race.

    Attributes
    ----------
    name : str
    schema : Schema
        Its table.
    settings : type
        Its settings.
    carry_on : callable (run, progress, workers)
        Do whatever is not done yet and gather the tables.
    write : callable (run)
        Write the report; returns its path.
    report : callable (run), optional
        Verdict and tables for the terminal; None for the one-shot race, which the command line shows in its own way.
    spreads : bool
        Whether it can use several workers.
    """

    name: str
    schema: Schema
    settings: type[RaceSettings]
    carry_on: Callable[[Run, Progress, Workers], None]
    write: Callable[[Run], Path]
    report: Callable[[Run], Report] | None = None
    spreads: bool = False

    def check(self, workers: Workers) -> None:
        """RaceError where the race cannot be spread like that."""
        workers.check()
        if not (self.spreads or workers.is_one):
            raise RaceError(f"the {self.name} race runs on one core; leave the workers to the one-shot race")

    def start(self, results: Path, settings: RaceSettings, name: str | None = None) -> Run:
        """Make the run's folder."""
        return race.start(results, settings, name, self.name)


def _alone(carry_on: Callable[[Run, Progress], None]) -> Callable[[Run, Progress, Workers], None]:
    return lambda run, progress, workers: carry_on(run, progress)


KINDS = {kind.name: kind for kind in (
    Kind("oneshot", ONESHOT, RaceSettings, race.carry_on, markdown.write, spreads=True),
    Kind(anytime.KIND, anytime.ANYTIME, anytime.AnytimeSettings, _alone(anytime.carry_on), race_reports.write_anytime,
         race_reports.anytime_report),
    Kind(stream.KIND, stream.STREAM, stream.StreamSettings, _alone(stream.carry_on), race_reports.write_stream,
         race_reports.stream_report),
    Kind(closed_loop.KIND, closed_loop.LOOP, closed_loop.LoopSettings, _alone(closed_loop.carry_on), loop_report.write_loop,
         loop_report.loop_report))}


def kind_of(run: Run) -> Kind:
    """The kind of a run; RunError where its run.json names none that is known."""
    name: Any = run.settings.get("race", "oneshot")
    if name not in KINDS:
        raise RunError(f"{run.path / 'run.json'}: there is no race {name!r}; known are {', '.join(KINDS)}")
    return KINDS[name]
