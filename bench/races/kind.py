"""The kinds of race: how each is started, resumed and reported.

The folder is the registry: each ``report.py`` in a folder beside this file defines a kind.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from bench.messages.task import Progress, RaceError
from bench.processes.engine import Workers
from bench.races.driver import Race, drive
from bench.races.run_problems import left_out
from bench.races.settings import RaceSettings
from bench.report.report import Report
from bench.report.words import joined
from bench.report.writing import write_report
from bench.store import Run, RunError, Schema
from piezo_model.json_file import brief, convert

DEFAULT = "oneshot"


@dataclass(frozen=True)
class Kind:
    """One kind of race."""

    name: str
    """Name on the command line."""
    title: str
    """Title of its reports."""
    summary: str
    """Short description."""
    settings: type[RaceSettings]
    """Its settings; those made with :func:`bench.races.settings.option` are options of the command line."""
    race: type[Race[Any]]
    """Its requests to solvers, and the rows made of their answers."""
    report: Callable[[Run, Any], Report]
    """Makes the :class:`bench.report.report.Report` of a finished run from its rows and its settings."""

    @property
    def schema(self) -> Schema:
        """The table of its rows."""
        return self.race.schema

    def settings_of(self, run: Run) -> RaceSettings:
        """The settings of a run; RunError if they are not those of this kind."""
        try:
            return convert(run.settings["settings"], self.settings)
        except ValueError as error:
            raise RunError(
                f"{run.path / 'run.json'}: does not hold the settings of a race: {brief(error)}; if an earlier version "
                "of piezobench made the run, race again"
            ) from None

    def check(self, workers: Workers) -> None:
        """RaceError if the race cannot use these workers."""
        workers.check()
        if not (self.race.spreads or workers.is_one):
            raise RaceError(f"the {self.name} race runs on one core; leave the workers to the one-shot race")

    def start(self, results: Path, settings: RaceSettings, name: str) -> Run:
        """Create the folder of a run."""
        self.race.entries(settings)
        return Run.create(results, {"race": self.name, "settings": asdict(settings)}, name)

    def carry_on(self, run: Run, progress: Progress, workers: Workers) -> None:
        """Do the tasks that are not done yet, and gather the tables."""
        self.check(workers)
        with run.exclusive():
            drive(self.race(run, self.settings_of(run), progress), workers)
            progress("gathering the tables", 0, 1)
            run.finish(self.schema)

    def write(self, run: Run) -> tuple[Report, Path]:
        """Write ``report.md``, ``report.html`` and their files; returns the report and the path of ``report.md``."""
        report = self.report(run, self.settings_of(run))
        machines, conditions = [*run.machines.values()], run.settings.get("conditions", {})
        hosts = {part["host"] for part in conditions.get("parts", ())} or {*run.machine_names}
        scope = [report.scope, joined(sorted({f"{each['processor']}, {each['core']}" for each in machines}))]
        if "sentinel_drift" in conditions:
            scope.append(f"the machine's speed drifted by {100.0 * conditions['sentinel_drift']:.0f} %")
        limits = [
            f"{'One machine' if len(hosts) == 1 else f'{len(hosts)} hosts'}, one run: compare ratios, not "
            "microseconds.",
            *report.limits,
            *dict.fromkeys(warning for each in machines for warning in each["warnings"]),
            *conditions.get("warnings", []),
        ]
        report = replace(
            report,
            title=f"{self.title} {run.path.name}",
            scope="; ".join(filter(None, scope)) + ".",
            notes=[*filter(None, [report.failed]), *report.notes],
            limits=limits,
            environment=environment(run),
        )
        return report, write_report(report, run.path)


@cache
def kinds() -> dict[str, Kind]:
    """The kinds of race by name, the default one first."""
    names = sorted(
        (path.parent.name for path in Path(__file__).parent.glob("*/report.py")),
        key=lambda name: (name != DEFAULT, name),
    )
    return {name: import_module(f"{__package__}.{name}.report").KIND for name in names}


def kind_of(run: Run) -> Kind:
    """The kind of a run; RunError if it is unknown."""
    if run.race not in kinds():
        known = ", ".join(kinds())
        version = run.settings.get("version", 1)
        raise RunError(
            f"{run.path / 'run.json'}: there is no race {run.race[:60]!r}, which made this run of version {version}; "
            f"known are {known}"
        )
    return kinds()[run.race]


def open_run(path: Path) -> Run:
    """Open a run and check its kind and its settings; RunError if they do not fit."""
    run = Run.open(path)
    kind_of(run).settings_of(run)
    return run


def environment(run: Run) -> list[tuple[str, str]]:
    """Names and texts about machine, versions and settings."""
    settings = run.settings
    field = ", ".join(f"{name} {version}" for name, version in settings.get("field", {}).items())
    absent = ", ".join(settings.get("absent", {}))
    chosen = ", ".join(
        f"{name} {_text(value)}" for name, value in settings["settings"].items() if value not in ([], {}, None, "")
    )
    told: list[tuple[str, str]] = []
    for each in run.machines.values():
        told += [
            ("machine", f"{each['processor']}, {each['cores']} cores, {each['system']}"),
            ("Python", f"{each['python']}; {', '.join(map(' '.join, each['versions'].items()))}"),
            ("commit", each.get("environment", {}).get("commit", "")),
        ]
    told += [
        ("settings", chosen),
        ("solvers", field),
        ("absent", absent),
        ("not raced", "; ".join(f"{name}: {reason}" for name, reason in left_out(run))),
    ]
    return [(name, text) for name, text in told if text]


def _text(value: Any) -> str:
    if isinstance(value, list | dict):
        items = value.items() if isinstance(value, dict) else ((None, item) for item in value)
        return "(" + ", ".join(f"{name} {item}" if name else str(item) for name, item in items) + ")"
    return str(value)
