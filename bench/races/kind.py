"""What a kind of race is to those above it: how it is set up, carried on, reported and shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.passed.progress import Progress
from bench.passed.race_error import RaceError
from bench.processes.engine import Workers
from bench.races.field import checked
from bench.races.run_report import of_run
from bench.races.settings import RaceSettings
from bench.report.report import Report
from bench.report.writing import write_report
from bench.store import Run, Schema
from bench.timing import machine
from solvers.registry import Entry


@dataclass(frozen=True)
class Kind:
    """One kind of race."""

    name: str
    """That of its folder."""
    title: str
    """Of its reports."""
    summary: str
    """What it races, in a few words."""
    schema: Schema
    """Its table."""
    settings: type[RaceSettings]
    """Its settings; those that are made with :func:`bench.races.settings.option` are options of the command line."""
    race: Callable[[Run, Progress, Workers], None]
    """Do every task that is not done yet (``run.is_done``) and save each (``run.save``); a resumed run calls it again."""
    report: Callable[[Run], Report]
    """Make the :class:`bench.report.report.Report` of a finished run."""
    spreads: bool = False
    """Whether it can use several workers."""
    entries: Callable[[Any], Sequence[Entry]] = checked
    """Who is asked for by these settings; RaceError where there is nobody of a name."""

    def check(self, workers: Workers) -> None:
        """RaceError where the race cannot be spread like that."""
        workers.check()
        if not (self.spreads or workers.is_one):
            raise RaceError(f"the {self.name} race runs on one core; leave the workers to the one-shot race")

    def start(self, results: Path, settings: RaceSettings, name: str | None = None) -> Run:
        """Make the run's folder."""
        self.entries(settings)
        return Run.create(results, {"race": self.name, "settings": settings.to_dict(), "machine": machine.describe()}, name)

    def carry_on(self, run: Run, progress: Progress, workers: Workers | None = None) -> None:
        """Do whatever is not done yet and gather the tables."""
        workers = workers or Workers()
        self.check(workers)
        with run.alone():
            self.race(run, progress, workers)
            progress("gathering the tables", 0, 1)
            run.finish(self.schema)

    def write(self, run: Run) -> tuple[Report, Path]:
        """Write ``report.md`` and ``report.html`` with what lies beside them; returns the report and the path of the first."""
        report = of_run(run, self.title, self.report(run))
        return report, write_report(report, run.path)
